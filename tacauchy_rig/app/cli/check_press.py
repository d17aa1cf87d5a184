"""``tacauchy-rig check-press``: compare a press with an earlier one: keep, recalibrate, replace."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tacauchy_rig.app.cli.options import JsonFile, Overrides
from tacauchy_rig.app.cli.output import say, write_json

USUAL_N = 2.0
"""Enough to measure modulus and image, and harmless to any gel."""


def check_press(
    before: Annotated[
        Path, typer.Argument(metavar="RUN", help="An earlier run of this sensor and tool.")
    ],
    path: Annotated[
        Path | None,
        typer.Argument(
            metavar="CONFIG|RUN",
            help="A rig.toml to press by, or a later run; the dry run's if absent.",
        ),
    ] = None,
    overrides: Overrides = None,
    json_file: JsonFile = None,
) -> None:
    """Press once and say whether the sensor is still what it was in an earlier run.

    Example: tacauchy-rig check-press runs/20261101-090000-first rig.toml
    """
    from tacauchy_rig.app.cli.session import recorded
    from tacauchy_rig.app.gel_health.comparison import Advice, compare_runs, nearest_force_n
    from tacauchy_rig.app.replay.opening import open_run

    known = open_run(before)
    target_n = nearest_force_n(known, USUAL_N)
    one = (f'protocol.force_targets=["{target_n:g} N"]', 'run.name="check-press"')
    folder = recorded(path, [*(overrides or ()), *one]).paths.root
    state = compare_runs(known, open_run(folder))
    for each in state.changes:
        number, unit = (each.value, f" {each.unit}") if each.unit else (100.0 * each.value, " %")
        scale = 1.0 if each.unit else 100.0
        say(
            f"{each.name:22} {number:+.2f} +- {scale * each.uncertainty:.2f}{unit} "
            f"(limit {scale * each.limit:g}{unit}){'  <-' if each.counts else ''}"
        )
    say(f"{state.advice.value}: {state.reason}")
    write_json(json_file, {"before": str(before), "now": str(folder), "state": state})
    raise typer.Exit(0 if state.advice is Advice.KEEP else 1)
