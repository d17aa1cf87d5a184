"""``python -m tests.studies beyond``: are presses beyond what a gel can bear right or refused?"""

from __future__ import annotations

from typing import Annotated

import typer

from tacauchy_rig.app.cli.options import JsonFile
from tacauchy_rig.app.cli.output import say, show_table, write_json
from tests.studies.beyond.presses import answers_table, drawn, judged, line


def beyond_check(
    presses: Annotated[int, typer.Option("--presses", min=1, help="How many are drawn.")] = 200,
    seed: Annotated[int, typer.Option("--seed", help="Of the draw.")] = 1,
    limit: Annotated[float, typer.Option("--limit", help="Of one press [s of processor].")] = 60.0,
    finer: Annotated[
        float, typer.Option("--finer", help="Of what judges it [s likewise].")
    ] = 120.0,
    refinement: Annotated[
        float, typer.Option("--refinement", help="Shorter edges than preset fast's, so many times.")
    ] = 1.0,
    first: Annotated[int, typer.Option("--first", help="Number to begin with.")] = 0,
    json_file: JsonFile = None,
) -> None:
    """Press too deep, too hard, with needles and at steep tilts: right, or an error, in time.

    Example: python -m tests.studies beyond --presses 20 --limit 15 --finer 40
    """
    found = []
    for number in range(first, first + presses):
        case = drawn(seed, number, refinement=refinement)
        found.append(judged(case, limit_s=limit, finer_limit_s=finer))
        say(line(found[-1]))
    table = answers_table(found, command="python -m tests.studies beyond")
    show_table(table)
    lines = [line(each) for each in found]
    write_json(json_file, {"table": table, "presses": lines})
    raise typer.Exit(0 if table.passed else 1)
