"""The ``tacauchy-rig`` program: commands, and the one place where errors become exit codes."""

import atexit
import errno
import gc
import logging
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperCommand, TyperGroup

from tacauchy_rig import __version__
from tacauchy_rig.app.cli.output import compilation_told, complain, documented, say
from tacauchy_rig.core.errors import AbortedError, RigError
from tacauchy_rig.core.store.atomic_write import write_error
from tacauchy_rig.core.threads import take_one_thread
from tacauchy_rig.core.time_limit_and_progress import told


@dataclass(frozen=True, slots=True)
class Group:
    """A group of commands: what its help says, and where each command's function is."""

    help: str
    places: Mapping[str, str]


Commands = Mapping[str, str | Group]
"""By name the place of a command's function, ``module:name``, or a group; in the help's order."""


def lazy_group(commands: Commands, headings: Mapping[str, str] | None = None) -> type[TyperGroup]:
    """Return the class of a group of commands, which are imported when they are asked for.

    Args:
        headings: Of the help, by the name of a command below it; none if absent.
    """

    class LazyGroup(TyperGroup):
        """A group of these commands."""

        def __init__(self, **attributes: Any) -> None:
            super().__init__(**attributes)
            # Misspelt names are compared with these.
            self.commands = {name: self._found(name, place) for name, place in commands.items()}

        def get_command(self, ctx: typer.Context, cmd_name: str) -> Any:  # type: ignore[override]
            """Return a command."""
            place = commands.get(cmd_name)
            if isinstance(place, str):
                module, _, attribute = place.partition(":")
                single = typer.Typer(add_completion=False)
                single.command(cmd_name)(documented(getattr(import_module(module), attribute)))
                self.commands[cmd_name] = typer.main.get_command(single)
                self.commands[cmd_name].name = cmd_name
            command: Any = super().get_command(ctx, cmd_name)
            if headings and command is not None:
                command.rich_help_panel = headings[cmd_name]
            return command

        @staticmethod
        def _found(name: str, place: str | Group) -> Any:
            """Return a group, or what stands for a command that is not imported yet."""
            if isinstance(place, str):
                return TyperCommand(name)
            inner = typer.Typer(
                name=name, cls=lazy_group(place.places), no_args_is_help=True, help=place.help
            )
            return typer.main.get_group(inner)

    return LazyGroup


def _of(module: str, *names: str) -> dict[str, str]:
    """Return where commands are, by name; their functions have the same names."""
    place = f"tacauchy_rig.app.cli.{module}"
    return {name: f"{place}:{name.replace('-', '_')}" for name in names}


PANELS: Mapping[str, Commands] = {
    "At the rig": {
        **_of("run_and_resume", "run", "dry-run", "resume"),
        **_of("doctor", "doctor", "check-press"),
        "emulate": Group(
            "Start emulated devices, inject faults, and write ball presses of an emulated sensor.",
            _of("emulate", "start", "presses", "fault"),
        ),
    },
    "Runs": _of("replay_report_export_serve", "replay", "report", "recover", "export", "serve"),
    "Simulation": {**_of("press", "press", "plan"), **_of("sweep", "sweep")},
    "Calibration": {
        "calibrate": Group(
            "Calibrate optics, scale, the gel's material, or the delays of streams.",
            _of("calibrate", "scale", "optics", "latency", "material"),
        )
    },
    "Other people's data": {
        "import": "tacauchy_rig.app.cli.import_and_judge:import_",
        **_of("import_and_judge", "judge"),
    },
    "Settings": {
        "config": Group(
            "Show, check and write rig.toml.",
            {
                **_of("config_commands", "show", "example"),
                "ceilings": "tacauchy_rig.app.cli.config_commands:show_ceilings",
            },
        )
    },
    "Studies": {
        "study": Group(
            "Measure the simulator on this machine: accuracy, hard cases, effects, speed.",
            _of(
                *("studies", "accuracy", "hard-cases", "effects", "verify"),
                *("modes", "objects", "paper", "bench"),
            ),
        )
    },
}
"""The headings of the help, and below each its commands and groups; a new one needs an entry."""
COMMANDS = {name: place for panel in PANELS.values() for name, place in panel.items()}

_INTERRUPTED = 130

app = typer.Typer(
    cls=lazy_group(
        COMMANDS, {name: heading for heading, panel in PANELS.items() for name in panel}
    ),
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Record tactile presses, simulate them at the measured forces, and report both.",
)


def _version(value: bool) -> None:
    if value:
        say(__version__)
        raise typer.Exit


@app.callback()
def options(
    debug: Annotated[bool, typer.Option("--debug", help="Show tracebacks and debug logs.")] = False,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Set up logging; ``--debug`` belongs before the command."""
    del version
    logging.basicConfig(
        level=logging.DEBUG if debug else logging.WARNING,
        format="%(asctime)s %(name)s " * debug + "%(levelname)s: %(message)s",
        stream=sys.stderr,
    )


def main() -> None:
    """Run the program; exit 0 pass, 1 criteria missed, 2 error, 3 aborted."""
    gc.set_threshold(100_000)  # importing the simulator takes a tenth less time
    atexit.register(gc.freeze)  # else the exit searches all that was imported, for 0.3 s
    run_program(app)


def run_program(program: typer.Typer) -> None:
    """Run a program of commands; its errors become exit codes here, and only here."""
    debug = "--debug" in sys.argv
    take_one_thread()
    try:
        with compilation_told(), told(complain):
            program(standalone_mode=True)
    except RigError as error:
        if debug:
            raise
        complain(f"error: {error}")
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        _interrupted()
    except SystemExit as end:  # what Typer makes of an interrupt, without a word
        if end.code != _INTERRUPTED:
            raise
        _interrupted()
    except Exception as error:  # the process's top: no traceback without --debug
        if debug:
            raise
        complain(f"error: {foreseen(error)}")
        sys.exit(RigError.exit_code)


def _interrupted() -> NoReturn:
    complain("aborted by Ctrl-C")
    sys.exit(AbortedError.exit_code)


UNWRITABLE = (errno.EROFS, errno.EACCES, errno.EPERM, errno.ENOSPC, errno.EDQUOT)
"""A disk that takes nothing: no fault of the program, wherever it was met."""


def foreseen(error: Exception) -> RigError:
    """Return what to tell of an error that nobody foresaw where it happened."""
    if isinstance(error, MemoryError):
        return RigError(
            f"out of memory: {error or 'no more is available'}",
            remedy="end other programs, lift `ulimit -v`, or take a coarser replay.preset",
        )
    if isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE):
        return RigError(
            f"too many open files: {error}",
            remedy="`ulimit -n 1024` before the command admits more",
        )
    if isinstance(error, OSError) and error.errno in UNWRITABLE and error.filename:
        return write_error(Path(error.filename), error)
    return RigError(
        f"{type(error).__name__}: {error}",
        remedy="this is a fault of the program; `tacauchy-rig --debug ...` shows where",
    )


if __name__ == "__main__":
    main()
