"""``tacauchy-rig study bench``: how long the simulator's work takes on this machine."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from sim.scene.scene import Preset, SceneTerms
from sim.studies.bench import Part
from tacauchy_rig.app.cli.study_command import study_command
from tacauchy_rig.core.study import Study


@study_command
def bench(
    sensor: Annotated[str, typer.Option("--sensor")] = "gelsight-mini",
    indenter: Annotated[str, typer.Option("--indenter")] = "cylinder:diameter=5mm,fillet=0.1mm",
    parts: Annotated[
        list[Part] | None, typer.Option("--part", help="Only this; may be repeated.")
    ] = None,
    drawn: Annotated[
        int | None,
        typer.Option(
            "--drawn",
            metavar="SEED",
            help="Of the scenes: a dozen that are drawn at random instead of the table's.",
        ),
    ] = None,
    tolerances: Annotated[
        list[str] | None,
        typer.Option(
            "--tolerance",
            metavar="5%|1%",
            help="Of the scenes: what their presets are chosen for (5%); may be repeated.",
        ),
    ] = None,
    device: Annotated[str, typer.Option("--device", help="Of the scenes: cpu or cuda:0.")] = "cpu",
    environments: Annotated[
        list[int] | None,
        typer.Option(
            "--environments",
            metavar="N",
            min=1,
            help="Of the scenes: so many in a batch, instead of one press alone; may be repeated.",
        ),
    ] = None,
    images: Annotated[
        bool,
        typer.Option(
            "--images",
            help="Of the scenes in batches: with the camera's image, the markers and the "
            "surface's stress in every frame.",
        ),
    ] = False,
    own_mesh: Annotated[
        bool,
        typer.Option(
            "--own-mesh",
            help="Of the scenes in batches: on the mesh that a batch makes itself, the same for "
            "every tolerance.",
        ),
    ] = False,
    reference: Annotated[
        bool,
        typer.Option(
            "--reference",
            help="Of the scenes: first press with preset reference; --json keeps that for "
            "--against.",
        ),
    ] = False,
    against: Annotated[
        Path | None,
        typer.Option(
            "--against", metavar="FILE", help="Of the scenes: what forces are compared with."
        ),
    ] = None,
) -> Study:
    """Time images, a replay, growth, start-up, threads, and scenes of every kind; minutes.

    --only takes a part of a name: a part of the benchmark, or scenes.

    Example: tacauchy-rig study bench --part scenes --only ball --out bench
    """
    from sim.studies.bench.scenes import Manner
    from sim.studies.bench.study import Bench, BenchOptions
    from tacauchy_rig.app.replay.rendering import replay_images
    from tacauchy_rig.core.config.load import load_config

    alone = [Manner(tolerance=each, device=device) for each in tolerances or ("5%",)]
    batches = [
        Manner(device=device, environments=count, images=images, own_mesh=own_mesh)
        for count in environments or ()
    ]
    if not batches:
        alone = [replace(each, images=images, own_mesh=own_mesh) for each in alone]
    return Bench(
        BenchOptions(
            terms=SceneTerms(indenter=indenter, sensor=sensor, depth="1mm", preset=Preset.FAST),
            forces_n=load_config(None).config.protocol.force_targets,
            make_images=replay_images,
            parts=parts or tuple(Part),
            drawn=drawn,
            manners=batches or alone,
            reference=reference,
            against=against,
        )
    )
