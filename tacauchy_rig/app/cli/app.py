"""The ``tacauchy-rig`` program: commands, and the one place where errors become exit codes."""

from __future__ import annotations

import errno
import logging
import sys
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from tacauchy_rig import __version__
from tacauchy_rig.app.cli.compilation import compilation_told
from tacauchy_rig.app.cli.lazy import lazy_group
from tacauchy_rig.app.cli.output import complain, say
from tacauchy_rig.core.errors import AbortedError, RigError
from tacauchy_rig.core.store.durable import write_error
from tacauchy_rig.core.threads import take_one_thread

COMMANDS = {
    "dry-run": "tacauchy_rig.app.cli.session:dry_run",
    "run": "tacauchy_rig.app.cli.session:run",
    "check-press": "tacauchy_rig.app.cli.check_press:check_press",
    "resume": "tacauchy_rig.app.cli.session:resume",
    "recover": "tacauchy_rig.app.cli.folders:recover",
    "import": "tacauchy_rig.app.cli.importing:import_",
    "replay": "tacauchy_rig.app.cli.folders:replay",
    "report": "tacauchy_rig.app.cli.folders:report",
    "export": "tacauchy_rig.app.cli.folders:export",
    "serve": "tacauchy_rig.app.cli.serve:serve",
    "judge": "tacauchy_rig.app.cli.judge:judge",
    "rigid": "tacauchy_rig.app.cli.studies.rigid:rigid",
    "press": "tacauchy_rig.app.cli.press:press",
    "plan": "tacauchy_rig.app.cli.press:plan",
    "accuracy": "tacauchy_rig.app.cli.studies.accuracy:accuracy",
    "bench": "tacauchy_rig.app.cli.studies.bench:bench",
    "torture": "tacauchy_rig.app.cli.studies.torture:torture",
    "verify": "tacauchy_rig.app.cli.studies.verify:verify",
    "effects-check": "tacauchy_rig.app.cli.studies.effects_check:effects_check",
    "modes": "tacauchy_rig.app.cli.studies.modes:modes",
    "objects": "tacauchy_rig.app.cli.studies.objects:objects",
    "paper": "tacauchy_rig.app.cli.studies.paper:paper",
    "doctor": "tacauchy_rig.app.cli.doctor:doctor",
}
"""Where each command is; a new one is a line here."""

_INTERRUPTED = 130

app = typer.Typer(
    cls=lazy_group(COMMANDS),
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="From a recorded tactile press to a force-matched replay and an honest report.",
)
app.add_typer(
    typer.Typer(
        cls=lazy_group(
            {
                "scale": "tacauchy_rig.app.cli.calibrate.scale:scale",
                "markers": "tacauchy_rig.app.cli.calibrate.markers:markers",
                "optics": "tacauchy_rig.app.cli.calibrate.optics:optics",
                "latency": "tacauchy_rig.app.cli.calibrate.latency:latency",
                "material": "tacauchy_rig.app.cli.calibrate.material:material",
            }
        ),
        no_args_is_help=True,
        help="Calibrate optics, scale, markers, the gel's material, or the delays of streams.",
    ),
    name="calibrate",
)
app.add_typer(
    typer.Typer(
        cls=lazy_group(
            {
                "start": "tacauchy_rig.app.cli.emulate.start:start",
                "presses": "tacauchy_rig.app.cli.emulate.presses:presses",
                "fault": "tacauchy_rig.app.cli.emulate.fault:fault",
            }
        ),
        no_args_is_help=True,
        help="Start emulated devices, make them fail, and write what an emulated sensor shows.",
    ),
    name="emulate",
)
app.add_typer(
    typer.Typer(
        cls=lazy_group(
            {
                "show": "tacauchy_rig.app.cli.config_commands:show",
                "example": "tacauchy_rig.app.cli.config_commands:example",
                "ceilings": "tacauchy_rig.app.cli.config_commands:show_ceilings",
            }
        ),
        no_args_is_help=True,
        help="Show, check and write rig.toml.",
    ),
    name="config",
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
        format="%(asctime)s %(name)s %(levelname)s %(message)s",
        stream=sys.stderr,
    )


def main() -> None:
    """Run the program; exit 0 pass, 1 criteria missed, 2 error, 3 aborted."""
    run_program(app)


def run_program(program: typer.Typer) -> None:
    """Run a program of commands; its errors become exit codes here, and only here."""
    debug = "--debug" in sys.argv
    take_one_thread()
    try:
        with compilation_told():
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
            f"out of memory: {error or 'no more can be had'}",
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
