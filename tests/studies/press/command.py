"""``python -m tests.studies press``: does one press tell an aged gel from a good one?"""

from __future__ import annotations

from typing import Annotated

import typer

from tacauchy_rig.app.cli.options import JsonFile
from tacauchy_rig.app.cli.output import show_table, write_json


def press_check(
    gels: Annotated[int, typer.Option("--gels", min=1, help="Of each kind.")] = 10,
    seed: Annotated[int, typer.Option("--seed", help="Of the first of them.")] = 1,
    json_file: JsonFile = None,
) -> None:
    """Judge emulated gels, good ones and aged ones, as `check-press` does.

    Example: python -m tests.studies press --gels 10
    """
    from tests.studies.press.aged_sensors import judged, state_table

    seeds = range(seed, seed + gels)
    found = [judged(number, aged=aged) for aged in (False, True) for number in seeds]
    table = state_table(found)
    show_table(table)
    write_json(json_file, {"table": table, "gels": found})
    raise typer.Exit(0 if table.passed else 1)
