"""Study "page": the cost of the operator's page, and how quickly it stops a run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tacauchy_rig.app.cli.options import JsonFile
from tacauchy_rig.app.cli.output import say, show_table, write_json, write_text

NOTE = (
    "Measured on emulated devices, by what the emulated arm truly did. Stops are asked for while "
    "the arm goes down, with one processor kept busy; pages are watched by three clients that read "
    "events and fetch pictures."
)


def page_check(
    stops: Annotated[int, typer.Option("--stops", min=1, help="By button and by key, each.")] = 50,
    pairs: Annotated[int, typer.Option("--pairs", min=1, help="Of the guard's reaction.")] = 20,
    trials: Annotated[int, typer.Option("--trials", min=1, help="Pressed with a page.")] = 6,
    out: Annotated[Path, typer.Option("--out", help="The page.")] = Path(
        "docs/results/page_check.md"
    ),
    work: Annotated[Path, typer.Option("--work", help="Folder of its runs.")] = Path(
        "runs/page-check"
    ),
    json_file: JsonFile = None,
) -> None:
    """Stop by page and key, react with a page and without, and press with a page.

    Example: python -m tests.studies page --stops 50 --pairs 20
    """
    from tacauchy_rig.core.page import criteria_page
    from tests.studies.page import measures

    work.mkdir(parents=True, exist_ok=True)
    say(f"{trials} trials with a page")
    watched = measures.watched_run(work.resolve() / "rates", watchers=3, trials=trials)
    tables = [measures.rate_table(watched)]
    say("stops by button and by key")
    tables.append(measures.stop_table(measures.stops(work / "stops", stops, say)))
    say("the guard with a page and without")
    tables.append(measures.reaction_table(measures.reactions(work / "guard", pairs, say)))
    for table in tables:
        show_table(table)
    command = f"python -m tests.studies page --stops {stops} --pairs {pairs}"
    write_text(out, criteria_page(tables, title="What the page costs", note=NOTE, command=command))
    write_json(json_file, {"tables": tables})
    say(f"page {out}")
    raise typer.Exit(0 if all(table.passed for table in tables) else 1)
