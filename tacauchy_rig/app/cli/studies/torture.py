"""``tacauchy-rig torture``: the cases a simulator breaks on, measured, as tables and a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tacauchy_rig.app.cli.options import Jobs, JsonFile
from tacauchy_rig.app.cli.output import complain, say, show_table, write_json, write_text
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.versions import machine, versions

if TYPE_CHECKING:
    from sim.studies.hard_cases.case import CaseResult


_PAGE = Path("docs/results/hard_cases.md")
# What the numbers depend on.
_NUMERICAL = ("tacauchy-rig", "python", "warp-lang", "numpy", "scipy", "pypardiso")


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
    """Measure the simulator's hard cases, each in a process of its own; exit 1 if one fails.

    Example: tacauchy-rig study hard-cases --rows 1,4
    """
    from sim.studies.hard_cases.case import observe
    from sim.studies.hard_cases.catalogue import select_cases

    chosen = select_cases(_numbers(rows))
    results = []
    # Every case starts a process of its own, so that threads are enough to wait for them.
    with ThreadPoolExecutor(jobs) as pool:
        for result in pool.map(observe, chosen):
            results.append(result)
            told = f"{result.number:2} {result.name}: {result.verdict}"
            complain(f"{told} after {result.wall_s:.1f} s")
    for result in results:
        show_table(result.table)
    say(_summary(results))
    used = versions()
    write_json(json_file, {"versions": used, "cases": results})
    file = out or (None if rows else _PAGE)
    if file is not None:
        command = f"tacauchy-rig torture --rows {rows}" if rows else "tacauchy-rig torture"
        write_text(file, markdown(results, command=command, used=used))
        say(f"table {file}")
    raise typer.Exit(0 if all(result.passed for result in results) else 1)


def _numbers(text: str) -> list[int]:
    try:
        return [int(part) for part in text.split(",") if part.strip()]
    except ValueError as error:
        raise ConfigError(
            f"--rows {text!r} is not a list of numbers", remedy="write it as --rows 1,4"
        ) from error


def _summary(results: Sequence[CaseResult]) -> str:
    """Return how many cases passed, and which did not."""
    failed = [str(result.number) for result in results if not result.passed]
    left = f"; failed: {', '.join(failed)}" if failed else ""
    return f"{len(results) - len(failed)} of {len(results)} hard cases pass{left}."


def markdown(results: Sequence[CaseResult], *, command: str, used: Mapping[str, str]) -> str:
    """Return the page.

    Args:
        results: In the order of the page.
        command: What made it.
        used: Versions of what was used.
    """
    from sim.studies.hard_cases.catalogue import all_cases
    from tacauchy_rig.core.page import page

    facts = {
        "summary": _summary(results),
        "results": results,
        "case_count": len(all_cases()),
        "command": command,
        "versions": ", ".join(f"{name} {used[name]}" for name in _NUMERICAL if name in used),
        "machine": machine(),
    }
    return page("tacauchy_rig.app.cli.studies", "hard_cases.md.jinja", facts)
