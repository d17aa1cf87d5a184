"""``tacauchy-rig calibrate optics``: from images of a pressed ball to a calibration file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sim.scene.scene import Preset
from tacauchy_rig.app.cli.options import Jobs, JsonFile
from tacauchy_rig.app.cli.output import Steps, complain, say, writable_folder, write_json
from tacauchy_rig.core.errors import ConfigError, command_line
from tacauchy_rig.core.quantities import Dimension, parse_quantity

if TYPE_CHECKING:
    from sim.optics.calibrate.cross_validation import PressScores, RenderedPress
    from tacauchy_rig.app.calibration.optics.run import OpticsResult


def optics(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Images of a pressed ball, or a run of one.")
    ],
    background: Annotated[
        Path | None, typer.Option(help="Frame without contact; in FOLDER or a path.")
    ] = None,
    ball_diameter: Annotated[
        str | None, typer.Option(help="Such as 4.70mm; a run states its own.")
    ] = None,
    scale: Annotated[
        str | None,
        typer.Option(
            help="Such as 19.58px/mm, or for x and y 19.6,19.4px/mm; a run's sensor states its own."
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Calibration file to write (.npz).")] = None,
    circles: Annotated[
        Path | None,
        typer.Option(
            help="CSV: image, center_x_px, center_y_px, radius_px; in FOLDER or a path. "
            "Without it FOLDER's circles.csv, and where there is none the contacts are found."
        ),
    ] = None,
    check: Annotated[
        Path | None, typer.Option(help="Folder of other labelled presses to score.")
    ] = None,
    sensor: Annotated[
        str | None, typer.Option(help="Sensor whose pad is pressed: the run's, else gelsight-mini.")
    ] = None,
    preset: Annotated[
        Preset, typer.Option(help="Preset that simulates the presses.")
    ] = Preset.BALANCED,
    folds: Annotated[int, typer.Option(min=2, help="Folds of the cross-validation.")] = 7,
    outputs: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Write each press as rendered by a model not fitted to it, for `judge`.",
        ),
    ] = None,
    jobs: Jobs = 2,
    json_file: JsonFile = None,
) -> None:
    """Fit the optics to ball presses, cross-validate, and write a calibration file.

    Example: tacauchy-rig calibrate optics presses --ball-diameter 4.70mm --out optics.npz
    """
    from tacauchy_rig.app.calibration.optics.of_run import keep_optics, request_of
    from tacauchy_rig.app.calibration.optics.run import calibrate_and_check
    from tacauchy_rig.app.judging.layout import check_empty
    from tacauchy_rig.app.replay.opening import open_run

    run = open_run(folder) if (folder / "run.json").is_file() else None
    request = request_of(
        folder,
        run,
        background=background,
        ball_diameter_m=None
        if ball_diameter is None
        else parse_quantity(ball_diameter, dimension=Dimension.LENGTH, field="--ball-diameter"),
        scale_px_m=None if scale is None else _scale(scale),
        out=out,
        sensor=sensor,
        circles=circles,
        check=check,
        preset=preset,
        folds=folds,
        jobs=jobs,
    )
    writable_folder(request.out.parent)
    if run is not None:
        others = len(run.records) - len(request.trials)
        say(
            f"{len(request.trials)} presses of a ball of {request.ball_diameter_m * 1e3:g} mm"
            + (f"; {others} others of the run are left out" if others else "")
        )
    if outputs is not None:
        check_empty(outputs)
    with Steps() as steps:
        result, held_out = calibrate_and_check(request, on_step=steps)
    if outputs is not None:
        _write_outputs(outputs, held_out, folds=folds, trials=request.trials)
    for warning in result.warnings:
        complain(f"warning: {warning}")
    _show(result)
    if run is not None:
        keep_optics(run, request, result)
        say(f"next: {command_line('replay', folder, '--optics', request.out)}")
    write_json(json_file, result)


def _write_outputs(
    folder: Path, images: Mapping[int, RenderedPress], *, folds: int, trials: Mapping[str, int]
) -> None:
    """Write presses held out as a simulator's outputs."""
    from tacauchy_rig import __version__
    from tacauchy_rig.app.judging.layout import write_outputs
    from tacauchy_rig.core.simulated import Outputs, PressOutput, Simulator
    from tacauchy_rig.core.versions import machine

    simulator = Simulator(
        name="tacauchy_rig's optics",
        version=__version__,
        milliseconds_an_image=1e3 * sum(each.seconds for each in images.values()) / len(images),
        machine=f"cpu, {machine()}, the formula in NumPy",
        note=f"Cross-validated, {folds} folds: of each press nothing is used but its contact's "
        "circle, as drawn or as found in its image, and how its markers say that ball and image "
        "moved sideways.",
    )
    presses = {
        trials.get(each.press.name, k): PressOutput(image=each.image)
        for k, each in sorted(images.items())
    }
    write_outputs(folder, Outputs(simulator=simulator, presses=presses))
    say(f"wrote {folder}")


def _show(result: OpticsResult) -> None:
    say(
        f"coverage   {result.coverage.slopes_seen_share:.0%} of the slopes, "
        f"{result.coverage.image_share:.0%} of the image"
    )
    say("                                  R2      error   SSIM    (no-contact frame)")
    for name, scores in (("cross-validated", result.cross_validation), ("check", result.check)):
        if scores is None:
            continue
        say(f"{name}: {scores.press_count} presses")
        for how, values in (
            ("circles nudged, frame's light", scores),
            ("as labelled, frame's light", scores.as_labelled),
            ("as labelled, no-contact light", scores.as_labelled_frames_as_they_came),
        ):
            say(f"  {how:32}{_line(values)}")
        say(
            f"  light {scores.light_rms_levels:.1f} grey levels rms, circles moved "
            f"{scores.nudge_rms_px:.1f} px rms"
        )
        if (markers := scores.markers) is not None:
            say(
                f"  markers: {markers.tracked} tracked to {markers.tracking_error_px:.2f} px, "
                f"{markers.lost} lost; drawn {markers.error_px:.2f} px "
                f"({markers.error_m * 1e3:.3f} mm) off in the median; at the contact they moved "
                f"{markers.moved_px:.1f} px and are {markers.near_error_px:.2f} px off, nine of "
                f"ten up to {markers.near_error_p90_px:.2f} px"
            )
    for path in result.files:
        say(f"wrote {path}")


def _line(scores: PressScores) -> str:
    without = f"{scores.r2_no_contact:.2f}, {scores.mae_no_contact:.1f}"
    return (
        f"{scores.r2:.4f}  {scores.mae:5.2f}   {scores.ssim_crop:.4f}  "
        f"({without}, {scores.ssim_crop_no_contact:.3f})"
    )


def _scale(text: str) -> tuple[float, float]:
    from sim.scene.terms import parse_pair

    x, y = parse_pair(text, Dimension.IMAGE_SCALE, "--scale")
    y = y if "," in text else x
    if not (x > 0.0 and y > 0.0):
        raise ConfigError(
            f'--scale: "{text}" is not positive', remedy="give pixels per mm, such as 19.58px/mm"
        )
    return x, y
