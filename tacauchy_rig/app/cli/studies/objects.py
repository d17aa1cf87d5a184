"""``tacauchy-rig study objects``: five objects in two sensors, drawn as their cameras see them."""

from __future__ import annotations

from typing import Annotated

import typer

from sim.scene.scene import Preset
from tacauchy_rig.app.cli.study_command import study_command
from tacauchy_rig.core.study import Study


@study_command
def objects(
    sensors: Annotated[
        str, typer.Option("--sensors", help="Names or files, with commas between.")
    ] = "gelsight-mini,digit",
    preset: Annotated[Preset, typer.Option("--preset")] = Preset.FAST,
) -> Study:
    """Press five objects, from sharp edges to smooth curves, and draw dents and tactile images.

    Example: tacauchy-rig study objects --out objects
    """
    from sim.studies.objects.study import Objects

    return Objects(sensors, preset)
