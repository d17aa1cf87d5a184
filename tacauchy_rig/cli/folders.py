"""Commands on a run folder: ``replay``, ``report``, ``export``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from reports.evidence.attempt import RunReading
from tacauchy_rig.cli.options import JsonFile, RunFolder
from tacauchy_rig.cli.output import say, write_json
from tacauchy_rig.cli.press_terms import parse_tolerance
from tacauchy_rig.loop.replaying import read_run, replay_run, report_run
from tacauchy_rig.store.export import ExportKind, export_run
from tacauchy_rig.store.run_store import RunStore


def replay(
    folder: RunFolder,
    tolerance: Annotated[
        str | None,
        typer.Option(
            "--tolerance",
            metavar="0.02N|1%",
            help="Take the cheapest preset that keeps F_z within it.",
        ),
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Simulate the trials of a run again and write its report."""
    run = read_run(RunStore.open(folder))
    replay_run(run, tolerance=None if tolerance is None else parse_tolerance(tolerance))
    _report(run, json_file)


def report(folder: RunFolder, json_file: JsonFile = None) -> None:
    """Write the report of a run again from what was recorded and replayed."""
    _report(read_run(RunStore.open(folder)), json_file)


def export(
    folder: RunFolder,
    out: Annotated[Path, typer.Argument(help="Folder to write to.")],
    kind: Annotated[
        ExportKind, typer.Option("--kind", help="Force and poses as CSV, or frames as JPEG.")
    ] = ExportKind.CSV,
    json_file: JsonFile = None,
) -> None:
    """Write a run's recordings for other tools."""
    written = export_run(folder, out, kind=kind)
    say(f"wrote {len(written)} files to {out}")
    write_json(json_file, {"files": written})


def _report(run: RunReading, json_file: Path | None) -> None:
    summary = report_run(run)
    write_json(json_file, summary.content)
    raise typer.Exit(0 if summary.passed else 1)
