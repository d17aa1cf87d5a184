"""``tacauchy-rig study modes``: the contact modes of the paper's figures, held to numbers."""

from __future__ import annotations

from typing import Annotated

import typer

from sim.scene.scene import Preset
from tacauchy_rig.app.cli.study_command import study_command
from tacauchy_rig.core.study import Study


@study_command
def modes(
    indenter: Annotated[
        str, typer.Option("--indenter", help="cylinder:diameter=,fillet= or sphere:diameter=")
    ] = "cylinder:diameter=5mm,fillet=0.5mm",
    preset: Annotated[Preset, typer.Option("--preset")] = Preset.FAST,
) -> Study:
    """Press, slide and twist on GelSight Mini, press a ball into three sensors; draw both.

    Example: tacauchy-rig study modes --out modes
    """
    from sim.studies.modes.study import Modes

    return Modes(indenter, preset)
