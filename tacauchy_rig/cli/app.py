"""The ``tacauchy-rig`` program: commands, and the one place where errors become exit codes."""

from __future__ import annotations

import logging
import sys
from typing import Annotated

import typer

from tacauchy_rig import __version__
from tacauchy_rig.cli import config_commands, emulate, session
from tacauchy_rig.cli.calibrate.markers import markers
from tacauchy_rig.cli.calibrate.optics import optics
from tacauchy_rig.cli.calibrate.scale import scale
from tacauchy_rig.cli.doctor import doctor
from tacauchy_rig.cli.folders import export, recover, replay, report
from tacauchy_rig.cli.output import complain, say
from tacauchy_rig.cli.press import plan, press
from tacauchy_rig.cli.studies.accuracy import accuracy
from tacauchy_rig.cli.studies.bench import bench
from tacauchy_rig.cli.studies.effects_check import effects_check
from tacauchy_rig.cli.studies.fault_table import fault_table
from tacauchy_rig.cli.studies.modes import modes
from tacauchy_rig.cli.studies.objects import objects
from tacauchy_rig.cli.studies.torture import torture
from tacauchy_rig.cli.studies.verify import verify
from tacauchy_rig.errors import AbortedError, RigError

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="From a recorded tactile press to a force-matched replay and an honest report.",
)
app.command("dry-run")(session.dry_run)
app.command("run")(session.run)
app.command("resume")(session.resume)
app.command("recover")(recover)
app.command("replay")(replay)
app.command("report")(report)
app.command("export")(export)
app.command("press")(press)
app.command("plan")(plan)
app.command("accuracy")(accuracy)
app.command("bench")(bench)
app.command("torture")(torture)
app.command("verify")(verify)
app.command("effects-check")(effects_check)
app.command("modes")(modes)
app.command("objects")(objects)
app.command("doctor")(doctor)
app.command("fault-table")(fault_table)
calibrate = typer.Typer(
    no_args_is_help=True,
    help="Calibrate a sensor's optics, the scale of its images, or how its markers move.",
)
calibrate.command("scale")(scale)
calibrate.command("markers")(markers)
calibrate.command("optics")(optics)
app.add_typer(calibrate, name="calibrate")
app.add_typer(emulate.app, name="emulate")
app.add_typer(config_commands.app, name="config")


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
    debug = "--debug" in sys.argv
    try:
        app(standalone_mode=True)
    except RigError as error:
        if debug:
            raise
        complain(f"error: {error}")
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        complain("aborted by Ctrl-C")
        sys.exit(AbortedError.exit_code)
    except Exception as error:  # the process's top: no traceback without --debug
        if debug:
            raise
        complain(
            f"error: {type(error).__name__}: {error}\n  -> this is a fault of the program; "
            "`tacauchy-rig --debug ...` shows where"
        )
        sys.exit(RigError.exit_code)


if __name__ == "__main__":
    main()
