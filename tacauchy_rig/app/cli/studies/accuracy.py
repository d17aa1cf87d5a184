"""``tacauchy-rig study accuracy``: what accuracy costs in time, for one press."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from sim.scene.scene import SceneTerms
from tacauchy_rig.app.cli.study_command import study_command
from tacauchy_rig.core.study import Study

if TYPE_CHECKING:
    from sim.optics.height.height_map import HeightMaps
    from tacauchy_rig.core.arrays import ImageArray


@study_command
def accuracy(
    sensor: Annotated[str, typer.Option("--sensor")] = "gelsight-mini",
    indenter: Annotated[str, typer.Option("--indenter")] = "cylinder:diameter=5mm,fillet=0.1mm",
    force: Annotated[str, typer.Option("--force")] = "4.7332N",
    full: Annotated[bool, typer.Option("--full", help="Measure many more settings.")] = False,
    seed: Annotated[
        list[int] | None,
        typer.Option(
            "--seed",
            help="Meshes of about the same sizes, 0 the presets' own; others are compared with "
            "the first. May be repeated.",
        ),
    ] = None,
    tolerances: Annotated[
        bool, typer.Option("--tolerances", help="Judge what --tolerance keeps, on twenty scenes.")
    ] = False,
) -> Study:
    """Press with many settings and show each one's error against its time.

    Example: tacauchy-rig study accuracy --sensor digit --force 2N --out accuracy
    """
    from sim.studies.accuracy.study import Accuracy

    terms = SceneTerms(indenter=indenter, sensor=sensor, force=force)
    return Accuracy(terms, _similarity, full=full, seeds=seed or (0,), tolerances=tolerances)


def _similarity(exact: ImageArray, found: ImageArray, maps: HeightMaps) -> tuple[float, float]:
    import numpy as np

    from reports.scores.metrics import structural_similarity_index, zero_mean_correlation
    from sim.optics.render.renderer import GREY_LEVEL

    inside = maps.contact
    changes = [image.astype(np.float64)[inside] - GREY_LEVEL for image in (exact, found)]
    return structural_similarity_index(exact, found), zero_mean_correlation(*changes)
