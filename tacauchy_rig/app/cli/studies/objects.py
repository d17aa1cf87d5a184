"""``tacauchy-rig objects``: five objects in two sensors, drawn as their cameras see them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Annotated

import typer

from sim.scene.scene import Preset
from tacauchy_rig.app.cli.options import FigureFolder, FigurePage, JsonFile
from tacauchy_rig.app.cli.output import say, writable_folder, write_json, write_text
from tacauchy_rig.core.errors import ConfigError

if TYPE_CHECKING:
    from reports.comparison.objects import ObjectPress as ScoredPress
    from reports.scores.metrics import ImageScores
    from sim.studies.objects.runs import ObjectPress


_SENSORS = "gelsight-mini,digit"


def objects(
    out: FigureFolder,
    sensors: Annotated[
        str, typer.Option("--sensors", help="Names or files, with commas between.")
    ] = _SENSORS,
    preset: Annotated[Preset, typer.Option("--preset")] = Preset.FAST,
    page: FigurePage = None,
    run: Annotated[
        Path | None,
        typer.Option(
            "--run",
            metavar="RUN",
            help="Draw a run's or an import's objects instead: camera's and simulated images.",
        ),
    ] = None,
    ours: Annotated[
        Path | None,
        typer.Option(
            "--ours",
            metavar="FOLDER",
            help="With --run, what stands for its replay: `calibrate optics --outputs`, or any "
            "simulator's folder of docs/judging.md.",
        ),
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Press five objects, from sharp edges to smooth curves, and draw dents and tactile images.

    With --run: what the camera showed of a run's objects, beside what was simulated of them.
    """
    if run is not None:
        _of_run(run, out, ours, page, json_file)
        return
    if ours is not None:
        raise ConfigError("--ours stands for a run's replay", remedy="name the run: --run RUN")
    from sim.studies.objects.figures import draw_objects
    from sim.studies.objects.runs import DEPTH_M

    writable_folder(out)
    images = None if page is None else writable_folder(page.parent / "images")
    say(f"{DEPTH_M * 1e3:g} mm deep, preset {preset.value}, nominal optics")
    runs = [_on_sensor(name.strip(), preset) for name in sensors.split(",") if name.strip()]
    for path in draw_objects(runs, out, page_folder=images):
        say(f"figure {path}")
    if page is not None:
        command = f"tacauchy-rig objects --out {out} --page {page}"
        command += f" --sensors {sensors}" if sensors != _SENSORS else ""
        command += f" --preset {preset}" if preset is not Preset.FAST else ""
        write_text(page, objects_page(runs, command=command, preset=preset))
        say(f"page {page}")
    rows = [
        {
            "sensor": run.sensor,
            "object": run.name,
            "force_n": run.force_n,
            "highest_over_object_m": run.highest_over_m,
            "processor_s": run.processor_s,
        }
        for sensor in runs
        for run in sensor
    ]
    write_json(json_file, {"preset": preset, "depth_m": DEPTH_M, "presses": rows})


def _of_run(
    run: Path, out: Path, ours: Path | None, page: Path | None, json_file: Path | None
) -> None:
    """Draw camera's and simulated images of a run's objects.

    Raises:
        ConfigError: A page was asked for.
        RecordError: No press has an image of both.
    """
    import matplotlib as mpl

    from reports.comparison.objects import object_presses
    from reports.figures.objects import draw_objects
    from tacauchy_rig.app.cli.judge import read_folders
    from tacauchy_rig.app.judging.of_run import OURS, task_of
    from tacauchy_rig.app.replay.opening import open_run
    from tacauchy_rig.app.replay.report import evidence_of
    from tacauchy_rig.core.figure_style import STYLE, save_figure

    if page is not None:
        raise ConfigError("--page is of the five objects", remedy="leave out --page or --run")
    reading = open_run(run)
    evidence = evidence_of(reading)
    simulated, simulator = {t.index: t.simulated_image for t in evidence.trials}, OURS
    if ours is not None:
        (given,) = read_folders([ours], evidence)
        simulated = {index: press.image for index, press in given.presses.items()}
        simulator = given.simulator.title
    indenters = {press.press: press.indenter for press in task_of(reading, evidence)[1]}
    images = {index: image for index, image in simulated.items() if image is not None}
    presses = object_presses(evidence, indenters, images)
    writable_folder(out)
    with mpl.rc_context(STYLE):
        figure = draw_objects(
            presses, camera=evidence.camera, simulator=simulator, marks=evidence.marks
        )
        for path in save_figure(figure, out, "objects"):
            say(f"figure {path}")
    content = {
        "run": run.name,
        "camera": evidence.camera,
        "marks": evidence.marks,
        "simulator": simulator,
        "presses": [
            {
                "trial": press.trial.index,
                "indenter": press.indenter,
                "force_n": press.trial.force_target_n,
                "scores": press.scores,
                "no_contact": press.no_contact,
            }
            for press in presses
        ],
    }
    write_json(json_file, content)
    for name in dict.fromkeys(press.indenter for press in presses):
        say(f"  {_means([press for press in presses if press.indenter == name])}")


def _means(presses: Sequence[ScoredPress]) -> str:
    """Return what the presses of one object score, and what no contact does."""
    ssim, floor_ssim = (
        fmean(s.ssim for s in scores) for scores in zip(*map(_scores, presses), strict=True)
    )
    psnr, floor_psnr = (
        fmean(s.psnr_db for s in scores) for scores in zip(*map(_scores, presses), strict=True)
    )
    return (
        f"{presses[0].indenter}, {len(presses)} presses: SSIM {ssim:.4f} (no contact "
        f"{floor_ssim:.4f}), PSNR {psnr:.2f} dB (no contact {floor_psnr:.2f} dB)"
    )


def _scores(press: ScoredPress) -> tuple[ImageScores, ImageScores]:
    return press.scores, press.no_contact


def _on_sensor(name: str, preset: Preset) -> list[ObjectPress]:
    from sim.sensor.sensor import load_sensor
    from sim.studies.objects.runs import press_object
    from sim.studies.objects.shapes import OBJECTS

    sensor = load_sensor(name)
    found = []
    for label in OBJECTS:
        found.append(press_object(label, sensor, preset=preset))
        run = found[-1]
        say(f"  {run.sensor}, {label}: {run.force_n:.3f} N [{run.processor_s:.0f} s]")
    return found


def objects_page(runs: Sequence[Sequence[ObjectPress]], *, command: str, preset: Preset) -> str:
    """Return what was found as a page of Markdown.

    Args:
        runs: Of each sensor the objects in one order.
        command: What makes the page.
    """
    from sim.studies.objects.runs import DEPTH_M
    from sim.studies.objects.shapes import OBJECTS
    from tacauchy_rig.core.page import page as written

    presses = [run for sensor in runs for run in sensor]
    return written(
        "tacauchy_rig.app.cli.studies",
        "objects.md.jinja",
        {
            "command": command,
            "depth_mm": f"{DEPTH_M * 1e3:g}",
            "preset": preset,
            "minutes": f"{sum(run.processor_s for run in presses) / 60.0:.0f}",
            "bodies": OBJECTS,
            "presses": presses,
            "seen_um": _seen_um,
        },
    )


def _seen_um(height_m: float) -> float:
    """Return a height [um]; below a picometre it is rounding."""
    return 0.0 if height_m < 1e-12 else height_m * 1e6
