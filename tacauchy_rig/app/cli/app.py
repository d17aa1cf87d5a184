"""The ``tacauchy-rig`` program: commands, and the one place where errors become exit codes."""

import atexit
import errno
import gc
import logging
import sys
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperCommand, TyperGroup

from tacauchy_rig import __version__
from tacauchy_rig.app.cli.output import compilation_told, complain, documented, say
from tacauchy_rig.core.errors import AbortedError, ConfigError, RigError
from tacauchy_rig.core.store.atomic_write import write_error
from tacauchy_rig.core.threads import take_one_thread
from tacauchy_rig.core.time_limit_and_progress import told


def lazy_group(
    places: Mapping[str, str],
    *,
    panels: Mapping[str, tuple[str, ...]] | None = None,
    moved: Mapping[str, str] | None = None,
) -> type[TyperGroup]:
    """Return the class of a group of commands.

    Args:
        places: Where each command's function is, ``module:name``; in the order of the help.
        panels: By heading, the commands that the help lists below it, groups included; then they
            are listed in this order.
        moved: By a name that was a command once, the command that is to be called instead.
    """

    class LazyGroup(TyperGroup):
        """A group of these commands."""

        def __init__(self, **attributes: Any) -> None:
            super().__init__(**attributes)
            # Misspelt names are compared with these.
            self.commands = {**{name: TyperCommand(name) for name in places}, **self.commands}

        def list_commands(self, ctx: typer.Context) -> list[str]:  # type: ignore[override]
            """Return all names in the order of the help."""
            first = [name for names in (panels or {}).values() for name in names]
            return first or super().list_commands(ctx)

        def get_command(self, ctx: typer.Context, cmd_name: str) -> Any:  # type: ignore[override]
            """Return a command; a name that moved is refused with where it went."""
            if moved and cmd_name in moved:
                raise ConfigError(
                    f"the command {cmd_name} has moved", remedy=f"call {moved[cmd_name]}"
                )
            if cmd_name in places:
                module, _, attribute = places[cmd_name].partition(":")
                group = typer.Typer(add_completion=False)
                group.command(cmd_name)(documented(getattr(import_module(module), attribute)))
                self.commands[cmd_name] = typer.main.get_command(group)
                self.commands[cmd_name].name = cmd_name
            command: Any = super().get_command(ctx, cmd_name)
            for panel, names in (panels or {}).items():
                if cmd_name in names:
                    command.rich_help_panel = panel
            return command

    return LazyGroup


def _of(module: str, *names: str) -> dict[str, str]:
    """Return where commands are, by name; their functions have the same names."""
    place = f"tacauchy_rig.app.cli.{module}"
    return {name: f"{place}:{name.replace('-', '_')}" for name in names}


COMMANDS = {
    **_of("run_and_resume", "run", "dry-run", "resume"),
    **_of("doctor", "doctor", "check-press"),
    **_of("replay_report_export_serve", "replay", "report", "recover", "export", "serve"),
    **_of("press", "press", "plan"),
    **_of("sweep", "sweep"),
    "import": "tacauchy_rig.app.cli.import_and_judge:import_",
    **_of("import_and_judge", "judge"),
}
"""Place of each command; a new command needs an entry here and in ``PANELS``."""

PANELS = {
    "At the rig": ("run", "dry-run", "resume", "doctor", "check-press", "emulate"),
    "Runs": ("replay", "report", "recover", "export", "serve"),
    "Simulation": ("press", "plan", "sweep"),
    "Calibration": ("calibrate",),
    "Other people's data": ("import", "judge"),
    "Settings": ("config",),
    "Studies": ("study",),
}
"""The headings of the help, and the commands below each."""

_STUDIES = ("accuracy", "hard-cases", "effects", "verify", "modes", "objects", "paper", "bench")
GROUPS = {
    "calibrate": (
        "Calibrate optics, scale, the gel's material, or the delays of streams.",
        _of("calibrate", "scale", "optics", "latency", "material"),
    ),
    "emulate": (
        "Start emulated devices, inject faults, and write ball presses of an emulated sensor.",
        _of("emulate", "start", "presses", "fault"),
    ),
    "config": (
        "Show, check and write rig.toml.",
        {
            **_of("config_commands", "show", "example"),
            "ceilings": "tacauchy_rig.app.cli.config_commands:show_ceilings",
        },
    ),
    "study": (
        "Measure the simulator on this machine: accuracy, hard cases, effects, speed.",
        _of("studies", *_STUDIES),
    ),
}
"""Help and commands of each group."""

_CHECKS = (
    *("fault-table", "page-check", "mounting-check", "gel-check", "press-check"),
    *("budget-check", "verdict-check", "residual-check", "judge-page"),
)
MOVED = {
    **{name: f"`tacauchy-rig study {name}`" for name in _STUDIES},
    "torture": "`tacauchy-rig study hard-cases`",
    "effects-check": "`tacauchy-rig study effects`",
    "rigid": "`tacauchy-rig judge --baseline rigid --run RUN --out DIR`",
    "tamper-table": "`python -m tests.studies tampering`, from a checkout of the repository",
    **{
        name: f"`python -m tests.studies {name.removesuffix('-check')}`, from a checkout of the "
        "repository"
        for name in _CHECKS
    },
}
"""Commands of an earlier version, and what to call instead; for one release."""
_MOVED_IN = {
    "calibrate": {"markers": "`calibrate optics`, which finds markers in the no-contact frame"}
}

_INTERRUPTED = 130

app = typer.Typer(
    cls=lazy_group(COMMANDS, panels=PANELS, moved=MOVED),
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Record tactile presses, simulate them at the measured forces, and report both.",
)
for _name, (_help, _places) in GROUPS.items():
    _group = lazy_group(_places, moved=_MOVED_IN.get(_name))
    app.add_typer(typer.Typer(cls=_group, no_args_is_help=True, help=_help), name=_name)


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
