"""``tacauchy-rig torture``: the cases a simulator breaks on, measured, as a table."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from sim.studies.hard_cases.case import CaseResult
from sim.studies.hard_cases.catalogue import select_cases
from sim.studies.hard_cases.observe import observe
from sim.studies.hard_cases.page import markdown, shown_numbers, summary_line, verdict
from tacauchy_rig.cli.options import JsonFile
from tacauchy_rig.cli.output import complain, console, say, write_json, write_text
from tacauchy_rig.cli.studies.side_by_side import Jobs
from tacauchy_rig.errors import ConfigError
from tacauchy_rig.versions import versions

_PAGE = Path("docs/hard_cases.md")


def torture(
    rows: Annotated[
        str, typer.Option("--rows", metavar="N,N", help="Only these cases, such as 1,4.")
    ] = "",
    jobs: Jobs = 1,
    json_file: JsonFile = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE",
            help=f"Write the table there; {_PAGE} if absent and every case is measured.",
        ),
    ] = None,
) -> None:
    """Measure the simulator's hard cases, each in a process of its own; exit 1 if one fails."""
    chosen = select_cases(_numbers(rows))
    results = []
    # Every case starts a process of its own, so that threads are enough to wait for them.
    with ThreadPoolExecutor(jobs) as pool:
        for result in pool.map(observe, chosen):
            results.append(result)
            told = f"{result.number:2} {result.name}: {verdict(result)}"
            complain(f"{told} after {result.wall_s:.1f} s")
    console.print(_table(results))
    say(summary_line(results))
    used = versions()
    write_json(json_file, {"versions": used, "cases": results})
    page = out or (None if rows else _PAGE)
    if page is not None:
        command = f"tacauchy-rig torture --rows {rows}" if rows else "tacauchy-rig torture"
        write_text(page, markdown(results, command=command, versions=used))
        say(f"table {page}")
    raise typer.Exit(0 if all(result.passed for result in results) else 1)


def _numbers(text: str) -> list[int]:
    try:
        return [int(part) for part in text.split(",") if part.strip()]
    except ValueError as error:
        raise ConfigError(
            f"--rows {text!r} is not a list of numbers", remedy="write it as --rows 1,4"
        ) from error


def _table(results: list[CaseResult]) -> Table:
    table = Table("row", "case", "criterion", "measured", "verdict", "s", show_lines=True)
    for result in results:
        table.add_row(
            str(result.number),
            result.name,
            result.criterion,
            result.failure or "\n".join(shown_numbers(result)),
            verdict(result),
            f"{result.wall_s:.0f}",
        )
    return table
