"""``tacauchy-rig study``: the studies that a user runs on their own machine."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sim.scene.scene import Preset, SceneTerms
from sim.studies.bench import Part
from tacauchy_rig.app.cli.output import write_text
from tacauchy_rig.app.cli.study_command import study_command
from tacauchy_rig.core.study import Study

if TYPE_CHECKING:
    from sim.optics.height.height_map import HeightMaps
    from tacauchy_rig.core.arrays import ImageArray

SensorName = Annotated[str, typer.Option("--sensor")]
IndenterTerms = Annotated[str, typer.Option("--indenter")]
PresetName = Annotated[Preset, typer.Option("--preset")]


@study_command
def accuracy(
    sensor: SensorName = "gelsight-mini",
    indenter: IndenterTerms = "cylinder:diameter=5mm,fillet=0.1mm",
    force: Annotated[str, typer.Option("--force")] = "4.7332N",
    full: Annotated[bool, typer.Option("--full", help="Measure many more settings.")] = False,
    seed: Annotated[
        list[int] | None,
        typer.Option(
            help="Draws meshes of about the same sizes; 0: the presets' own. The first is compared "
            "with the others. May be repeated."
        ),
    ] = None,
    tolerances: Annotated[
        bool, typer.Option("--tolerances", help="Test --tolerance on twenty scenes.")
    ] = False,
) -> Study:
    """Press with many settings; compare their errors and times.

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


@study_command
def hard_cases() -> Study:
    """Simulate hard cases, each in its own process.

    Example: tacauchy-rig study hard-cases --only 1 --only 14
    """
    from sim.studies.hard_cases.study import HardCases

    return HardCases()


@study_command
def effects(
    random: Annotated[int, typer.Option(metavar="N", help="Draw this many scenes instead.")] = 0,
    seed: Annotated[int, typer.Option(help="Seed of the drawn scenes.")] = 0,
    errors: Annotated[
        bool, typer.Option("--errors", help="Compare the stated errors with a finer mesh too.")
    ] = False,
) -> Study:
    """Press scenes with their planned effects and with all; compare outputs and times.

    A scene has 60 s if --limit is not given; one that takes longer is left, and named.

    Example: tacauchy-rig study effects --only "by force"
    """
    from sim.studies.effects.study import Effects

    return Effects(count=random, seed=seed, errors=errors)


@study_command
def verify() -> Study:
    """Compare presses with known solutions; takes minutes.

    Example: tacauchy-rig study verify --only punch --only hertz
    """
    from sim.studies.verification.study import Verification

    return Verification()


@study_command
def modes(
    indenter: Annotated[
        str, typer.Option(help="cylinder:diameter=,fillet= or sphere:diameter=")
    ] = "cylinder:diameter=5mm,fillet=0.5mm",
    preset: PresetName = Preset.FAST,
) -> Study:
    """Press, slide and twist on a GelSight Mini; press a ball into three sensors; draw both.

    Example: tacauchy-rig study modes --out modes
    """
    from sim.studies.modes.study import Modes

    return Modes(indenter, preset)


@study_command
def objects(
    sensors: Annotated[
        str, typer.Option(help="Names or files, with commas between.")
    ] = "gelsight-mini,digit",
    preset: PresetName = Preset.FAST,
) -> Study:
    """Press five objects, from sharp edges to smooth curves, and draw dents and tactile images.

    Example: tacauchy-rig study objects --out objects
    """
    from sim.studies.objects.study import Objects

    return Objects(sensors, preset)


@study_command
def paper(
    benchmarks: Annotated[Path, typer.Option(help="Folder of the kept benchmarks.")] = Path(
        "docs/results/benchmarks"
    ),
    report: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="RUN",
            help="Keep this run's scores among the benchmarks, in place of those kept before; "
            "may be repeated.",
        ),
    ] = None,
) -> Study:
    """Compare every number of the paper with ours: its model, benchmarks, reports.

    Example: tacauchy-rig study paper --out paper
    """
    from sim.studies.paper.kept import REPORTS_FILE, json_lines, of_run
    from sim.studies.paper.study import Paper

    if report:
        kept = json_lines([of_run(run) for run in report])
        write_text(benchmarks / REPORTS_FILE, kept, option="--benchmarks")
    return Paper(benchmarks)


@study_command
def bench(
    sensor: SensorName = "gelsight-mini",
    indenter: IndenterTerms = "cylinder:diameter=5mm,fillet=0.1mm",
    parts: Annotated[
        list[Part] | None, typer.Option("--part", help="Run only this part; may be repeated.")
    ] = None,
    drawn: Annotated[
        int | None,
        typer.Option(
            metavar="SEED", help="Scenes: a dozen, drawn at random, instead of the table's."
        ),
    ] = None,
    tolerances: Annotated[
        list[str] | None,
        typer.Option(
            "--tolerance",
            metavar="5%|1%",
            help="Scenes: tolerance that chooses the presets (5%); may be repeated.",
        ),
    ] = None,
    device: Annotated[str, typer.Option(help="Scenes: cpu or cuda:0.")] = "cpu",
    environments: Annotated[
        list[int] | None,
        typer.Option(
            metavar="N",
            min=1,
            help="Scenes: size of a batch, instead of one press alone; may be repeated.",
        ),
    ] = None,
    images: Annotated[
        bool,
        typer.Option(
            "--images",
            help="Scenes in batches: compute the camera's image, the markers and the "
            "surface's stress in every frame.",
        ),
    ] = False,
    reference: Annotated[
        bool,
        typer.Option(
            "--reference",
            help="Scenes: first press with preset reference; --json keeps the result for "
            "--against.",
        ),
    ] = False,
    against: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Scenes: reference forces.")
    ] = None,
) -> Study:
    """Time images, a replay, batches and scenes; takes minutes.

    --only takes a part of a name: a part of the benchmark, or scenes.

    Example: tacauchy-rig study bench --part scenes --only ball --out bench
    """
    from sim.studies.bench.scenes import Manner
    from sim.studies.bench.study import REFERENCE_FILE, Bench
    from tacauchy_rig.app.replay.rendering import replay_images
    from tacauchy_rig.core.config.load import load_config

    alone = [Manner(tolerance=each, device=device) for each in tolerances or ("5%",)]
    batches = [Manner(device=device, environments=count) for count in environments or ()]
    manners = [replace(each, images=images) for each in batches or alone]
    return Bench(
        terms=SceneTerms(indenter=indenter, sensor=sensor, depth="1mm", preset=Preset.FAST),
        forces_n=load_config(None).config.protocol.force_targets,
        make_images=replay_images,
        chosen=parts or tuple(Part),
        drawn=drawn,
        manners=manners,
        reference=reference,
        against=against or REFERENCE_FILE,
    )
