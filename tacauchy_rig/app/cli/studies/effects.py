"""``tacauchy-rig study effects``: plans of scenes that differ, held against everything on."""

from __future__ import annotations

from typing import Annotated

import typer

from tacauchy_rig.app.cli.study_command import study_command
from tacauchy_rig.core.study import Study


@study_command
def effects(
    random: Annotated[
        int, typer.Option("--random", metavar="N", help="Draw so many scenes instead.")
    ] = 0,
    seed: Annotated[int, typer.Option("--seed", help="What the scenes are drawn with.")] = 0,
    errors: Annotated[
        bool, typer.Option("--errors", help="Judge stated errors too, by a finer mesh.")
    ] = False,
) -> Study:
    """Press scenes under their plans and with everything on; say what that changes and costs.

    A scene has 60 s if --limit is not given; one that takes longer is left, and named.

    Example: tacauchy-rig study effects --only "by force"
    """
    from sim.studies.effects.study import Effects

    return Effects(count=random, seed=seed, errors=errors)
