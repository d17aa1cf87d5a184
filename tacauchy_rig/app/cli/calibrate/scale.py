"""``tacauchy-rig calibrate scale``: scale and centre of the camera, from a target or presses."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tacauchy_rig.app.cli.options import JsonFile
from tacauchy_rig.app.cli.output import say, write_json
from tacauchy_rig.core.errors import ConfigError

if TYPE_CHECKING:
    from sim.optics.calibrate.scale_fit import ScaleFit
    from sim.sensor.sensor import Sensor


def scale(
    image: Annotated[
        Path | None, typer.Argument(metavar="[IMAGE]", help="Image of a target on the gel.")
    ] = None,
    target: Annotated[
        str | None,
        typer.Option(
            help="charuco:columns=8,rows=6,square=2mm,marker=1.5mm[,dictionary=4X4_50], "
            "aruco:columns=5,rows=4,marker=2mm,gap=0.5mm or dots:columns=7,rows=5,pitch=2mm"
        ),
    ] = None,
    presses: Annotated[
        Path | None,
        typer.Option(
            help="Folder with positions.csv (image, x_m, y_m), circles.csv and the images."
        ),
    ] = None,
    sensor: Annotated[
        str | None,
        typer.Option(
            help="Crop and resize the raw image of a target as this sensor's camera does; "
            "without it the image is taken as it is."
        ),
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Fit mm per pixel in x and y, rotation and centre of a camera.

    Example: tacauchy-rig calibrate scale target.png --target dots:columns=7,rows=5,pitch=2mm
    """
    from sim.sensor.sensor import load_sensor

    if presses is not None and sensor is not None:
        raise ConfigError(
            "--sensor crops the image of a target; images of --presses are taken as they are",
            remedy="leave --sensor out, and give presses at the size that is scored",
        )
    if presses is not None and image is None and target is None:
        fit, points = _from_presses(presses)
    elif presses is None and image is not None and target is not None:
        fit, points = _from_target(image, target, None if sensor is None else load_sensor(sensor))
    else:
        raise ConfigError(
            "calibrate scale needs an image with --target, or --presses",
            remedy="tacauchy-rig calibrate scale target.png --target "
            "charuco:columns=8,rows=6,square=2mm,marker=1.5mm",
        )
    _show(fit, points)
    geometry = fit.geometry
    found = {
        "scale_x_m_px": geometry.scale_x_m,
        "scale_y_m_px": geometry.scale_y_m,
        "scale_error_m_px": list(fit.scale_error_m),
        "rotation_rad": geometry.rotation_rad,
        "rotation_error_rad": fit.rotation_error_rad,
        "mirrored": geometry.mirrored,
        "centre_x_px": geometry.centre_x_px,
        "centre_y_px": geometry.centre_y_px,
        "centre_error_px": fit.centre_error_px,
        "shear_rad": fit.shear_rad,
        "residual_px": fit.residual_px,
        "width_px": geometry.width,
        "height_px": geometry.height,
        "points": points,
    }
    write_json(json_file, found)


def _from_target(image: Path, text: str, sensor: Sensor | None) -> tuple[ScaleFit, str]:
    from reports.evidence.attempt import crop_and_resize
    from sim.optics.calibrate.ball_press import read_rgb
    from sim.optics.calibrate.scale_fit import find_target, fit_scale, parse_target
    from tacauchy_rig.app.replay.opening import scored_geometry
    from tacauchy_rig.core.rgb import to_grey

    seen = read_rgb(image)
    if sensor is not None:
        seen = crop_and_resize(seen, scored_geometry(sensor))
    grey = to_grey(seen)
    found = find_target(parse_target(text), grey, name=str(image))
    fit = fit_scale(found.positions_m, found.pixels, width=grey.shape[1], height=grey.shape[0])
    return fit, f"{len(found.pixels)} of {found.wanted} points of the target"


def _from_presses(folder: Path) -> tuple[ScaleFit, str]:
    import numpy as np

    from sim.optics.calibrate.ball_press import read_ball_presses
    from sim.optics.calibrate.scale_fit import fit_scale, read_positions

    places = read_positions(folder / "positions.csv")
    known = [p for p in read_ball_presses(folder, folder / "circles.csv") if p.name in places]
    if not known:
        raise ConfigError(
            f"{folder}: no image of circles.csv is in positions.csv",
            remedy="name the same images in both",
        )
    height, width = known[0].image.shape[:2]
    fit = fit_scale(
        np.array([places[press.name] for press in known]),
        np.array([(press.circle.x_px, press.circle.y_px) for press in known]),
        width=width,
        height=height,
    )
    return fit, f"{len(known)} presses"


def _show(fit: ScaleFit, points: str) -> None:
    geometry = fit.geometry
    off_x = geometry.centre_x_px - 0.5 * (geometry.width - 1)
    off_y = geometry.centre_y_px - 0.5 * (geometry.height - 1)
    size = f"{geometry.width} x {geometry.height} px"
    say(f"from {points}, residual {fit.residual_px:.2f} px rms in an image of {size}")
    scales = tuple(
        zip("xy", (geometry.scale_x_m, geometry.scale_y_m), fit.scale_error_m, strict=True)
    )
    for axis, value, error in scales:
        say(
            f"scale {axis}    {value * 1e3:.5f} mm/px +- {error / value:.2%}, "
            f"{1e-3 / value:.3f} px/mm"
        )
    say(
        f"rotation   {math.degrees(geometry.rotation_rad):.3f} +- "
        f"{math.degrees(fit.rotation_error_rad):.3f} deg{', mirrored' * geometry.mirrored}, "
        f"axes {math.degrees(fit.shear_rad):.3f} deg from a right angle"
    )
    say(
        f"centre     column {geometry.centre_x_px:.2f}, row {geometry.centre_y_px:.2f} "
        f"(+- {fit.centre_error_px:.2f} px), {off_x:.2f}, {off_y:.2f} px from the image's middle"
    )
    say("for the sensor's file:")
    for axis, value, error in scales:
        say(_line(f"pixel_{axis}", value, error))
    for (axis, value, _), off in zip(scales, (off_x, off_y), strict=True):
        say(_line(f"centre_{axis}", -off * value, fit.centre_error_px * value))


def _line(key: str, value_m: float, error_m: float) -> str:
    return (
        f'{key} = {{ value = "{value_m * 1e3:.5f} mm", '
        f'uncertainty = "{max(error_m * 1e3, 1e-5):.5f} mm", source = "calibrate scale" }}'
    )
