"""``tacauchy-rig study paper``: each number of the paper beside ours, with verdicts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tacauchy_rig.app.cli.output import write_text
from tacauchy_rig.app.cli.study_command import study_command
from tacauchy_rig.core.study import Study


@study_command
def paper(
    benchmarks: Annotated[
        Path, typer.Option("--benchmarks", help="Folder of the benchmarks that are kept.")
    ] = Path("docs/results/benchmarks"),
    report: Annotated[
        list[Path] | None,
        typer.Option(
            "--report",
            metavar="RUN",
            help="Keep this run's scores among the benchmarks, in place of those kept before; "
            "may be repeated.",
        ),
    ] = None,
) -> Study:
    """Set every number of the paper beside ours: its model pressed here, benchmarks, reports.

    Example: tacauchy-rig study paper --out paper
    """
    from sim.studies.paper.kept import REPORTS_FILE, json_lines, of_run
    from sim.studies.paper.study import Paper

    if report:
        kept = json_lines([of_run(run) for run in report])
        write_text(benchmarks / REPORTS_FILE, kept, option="--benchmarks")
    return Paper(benchmarks)
