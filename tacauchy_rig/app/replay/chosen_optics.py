"""The optics and scale that a run's images are rendered with, and their source."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from sim.optics.calibrate.ball_press import Circle, read_ball_presses, read_rgb
from sim.optics.calibrate.circle_and_light import pressed_scene
from sim.optics.calibrate.gel_profile import rest_slopes, touching_places
from sim.optics.calibrate.pixel_scale import ScaleFit, fit_scale, read_positions
from sim.optics.calibrate.shadow_blur_fit import BLUR_PX, SHADOWS, calibrate_presses, read_shadows
from sim.optics.colour.model_interface_and_response import ColourModel
from sim.optics.colour.nominal_optics import exponents_for, nominal_model
from sim.optics.colour.photometric import load_photometric
from sim.optics.render.renderer import GREY_LEVEL
from sim.scene.pad import Pad
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.lamps_and_optics import ShadowCaster
from sim.sensor.sensor import Sensor
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.time_limit_and_progress import say

WIDTH, HEIGHT = "width_px", "height_px"  # names in a calibration's provenance
SCALE_X, SCALE_Y = "scale_x_m_px", "scale_y_m_px"
VIEW = "view"  # fields of its geometry that were fitted to places of presses
CAMERA_DISTANCE = "camera_distance_m"
CIRCLES, POSITIONS, NO_CONTACT = "circles.csv", "positions.csv", "no_contact.png"
VIEWED = ("scale_x_m", "scale_y_m", "centre_x_px", "centre_y_px", "rotation_rad", "mirrored")
_SCALES_APART = 0.05  # of each other: a calibration's and the sensor file's


@dataclass(frozen=True, slots=True, kw_only=True)
class OpticalCalibration:
    """Colour of a surface, where each pixel looks, what casts shadows, the camera's blur [px]."""

    model: ColourModel
    geometry: CameraGeometry
    shadows: ShadowCaster | None = None
    blur_px: float = 0.0


Calibrate = Callable[[Sensor], OpticalCalibration]
"""Calibrates the optics of a sensor."""


def calibrate_folder(folder: Path, sensor: Sensor, *, ball_diameter_m: float) -> OpticalCalibration:
    """Fit scale and optics to a folder of ball presses.

    Clicked circles are off by a pixel or two; the optical fit nudges them, so the scale is fitted
    to the nudged ones and the optics once more to that scale.

    Args:
        folder: ``circles.csv``, the images that it names, ``no_contact.png`` and, for the scale,
            ``positions.csv``.
        sensor: Its pad is pressed in the simulator to know the gel around the ball; the camera of
            its file is kept where there are no positions.

    Raises:
        ConfigError: A file is missing or damaged, or there are too few presses.
    """
    nominal = sensor.camera
    presses = read_ball_presses(folder, folder / CIRCLES)
    places = read_positions(folder / POSITIONS) if (folder / POSITIONS).exists() else {}
    unloaded = read_rgb(folder / NO_CONTACT)
    scene = pressed_scene(sensor, unloaded, nominal, ball_diameter_m=ball_diameter_m)
    presses = [scene.followed(press) for press in presses]
    residual_px = None
    if places:
        circles = calibrate_presses(presses, scene, sensor.optics.shadows, blurred=False).circles
        seen = [
            (c, places[p.name]) for p, c in zip(presses, circles, strict=True) if p.name in places
        ]
        fit, told = fitted_view(seen, nominal, sensor.pad, ball_radius_m=0.5 * ball_diameter_m)
        geometry = replace(fit.geometry, crop_fraction=nominal.crop_fraction)
        scene = replace(scene, geometry=geometry, rest_slope=rest_slopes(sensor.pad, geometry))
        residual_px = fit.residual_px
        say(f"  {told}")
    found = calibrate_presses(presses, scene, sensor.optics.shadows)
    shadows = found.shadows
    geometry = replace(scene.geometry, distance_m=found.motion.distance_m)
    source = {
        BLUR_PX: found.blur_px,
        SHADOWS: None if shadows is None else asdict(shadows),
        "source": f"{len(presses)} ball presses in {folder.name}",
        "ball_diameter_m": ball_diameter_m,
        "scale_residual_px": residual_px,
    }
    model = replace(found.model, provenance={**found.model.provenance, **source})
    return OpticalCalibration(
        model=model, geometry=geometry, shadows=shadows, blur_px=found.blur_px
    )


def fitted_view(
    seen: Sequence[tuple[Circle, tuple[float, float]]],
    stated: CameraGeometry,
    pad: Pad,
    *,
    ball_radius_m: float,
) -> tuple[ScaleFit, str]:
    """Fit where pixels look to where contacts of a ball are seen; return it also in words.

    Args:
        seen: Contacts, and where the axis of the ball was, x and y from the pad's centre [m].

    Raises:
        ConfigError: Fewer than four places, all of them on one line, or at another scale than is
            stated.
    """
    # The robot states where its axis is, not where the ball touches a dome.
    axes_m = np.array([place for _, place in seen]).reshape(-1, 2)
    fit = fit_scale(
        touching_places(axes_m, pad, ball_radius_m=ball_radius_m),
        np.array([(circle.x_px, circle.y_px) for circle, _ in seen]),
        width=stated.width,
        height=stated.height,
    )
    view, middle_m = fit.geometry, fit.geometry.centre_from_middle_m
    told = (
        f"scale {view.scale_x_m * 1e3:.4f} x {view.scale_y_m * 1e3:.4f} mm/px, pad's centre "
        f"{middle_m[0] * 1e3:+.3f}, {middle_m[1] * 1e3:+.3f} mm from the image's, residual "
        f"{fit.residual_px:.2f} px over {len(seen)} presses"
    )
    scales = view.scale_x_m / stated.scale_x_m, view.scale_y_m / stated.scale_y_m
    if max(abs(scale - 1.0) for scale in scales) > _SCALES_APART:
        raise ConfigError(f"places contradict the stated scale: {told}", remedy="check both")
    return fit, told


def optics_of(
    given: str, sensor: Sensor, *, calibrate: Calibrate | None = None
) -> OpticalCalibration:
    """Return how a sensor's images are rendered.

    A calibration file comes first, then ``calibrate`` if the sensor's renderer can be calibrated,
    then the nominal optics of the sensor's file. The model's provenance records which.

    Args:
        calibrate: How the sensor is calibrated without a file.

    Raises:
        ConfigError: The calibration file is missing or damaged, or the sensor names no lamps.
    """
    if given:
        return calibrated_optics(given, sensor)
    if calibrate is not None and sensor.optics.renderer.exponents is not None:
        return calibrate(sensor)
    say("  optics not calibrated: rendering with the nominal optics of the sensor's file")
    return nominal_optics(sensor)


def nominal_optics(sensor: Sensor) -> OpticalCalibration:
    """Return the lamps that a sensor's file names, as they are without a calibration.

    Raises:
        ConfigError: The file names no lamps.
    """
    return OpticalCalibration(
        model=nominal_model(sensor), geometry=sensor.camera, shadows=sensor.optics.shadows
    )


def calibrated_optics(given: str, sensor: Sensor) -> OpticalCalibration:
    """Return the optics of a calibration file, with its view or that of the sensor's file.

    Raises:
        ConfigError: The file is missing or damaged, or is of images of another size or scale, or
            the sensor's renderer cannot be calibrated.
    """
    exponents_for(sensor)
    nominal = sensor.camera
    model = load_photometric(Path(given))
    _check_view(given, model.provenance, nominal)
    blur_px = model.provenance.get(BLUR_PX, 0.0)
    if isinstance(view := model.provenance.get(VIEW), dict):
        nominal = TypeAdapter(CameraGeometry).validate_python({**asdict(nominal), **view})
    distance_m = model.provenance.get(CAMERA_DISTANCE)
    if isinstance(distance_m, float):
        nominal = replace(nominal, distance_m=distance_m)
    return OpticalCalibration(
        model=model,
        geometry=nominal,
        shadows=read_shadows(model.provenance),
        blur_px=blur_px if isinstance(blur_px, float) else 0.0,
    )


def _check_view(given: str, provenance: Mapping[str, object], nominal: CameraGeometry) -> None:
    """Refuse a calibration of images of another size or scale than a run's are scored at."""
    made = tuple(provenance.get(name) for name in (WIDTH, HEIGHT))
    if made[0] is not None and made != (nominal.width, nominal.height):
        raise ConfigError(
            f"sensor.optics_calibration {given} is of images of {made[0]} x {made[1]} px, the "
            f"sensor's are scored at {nominal.width} x {nominal.height} px",
            remedy="calibrate with images of the sensor's crop and size, or give its own file",
        )
    for name, scale_m in ((SCALE_X, nominal.scale_x_m), (SCALE_Y, nominal.scale_y_m)):
        known = provenance.get(name)
        if isinstance(known, float) and abs(known / scale_m - 1.0) > _SCALES_APART:
            raise ConfigError(
                f"sensor.optics_calibration {given} is of {known * 1e3:.4f} mm per pixel, the "
                f"sensor's file says {scale_m * 1e3:.4f} mm",
                remedy="calibrate with this sensor's --scale, or correct the sensor's file",
            )


def optics_and_frame(
    sensor: Sensor, given: Path | None, background: Path | None
) -> tuple[OpticalCalibration, ImageArray]:
    """Return a sensor's optics and its no-contact frame.

    Args:
        given: What ``calibrate optics`` wrote; None is the nominal optics.
        background: The frame of the scored size; None is an even grey.

    Raises:
        ConfigError: A file is missing, damaged, or of another sensor.
    """
    optics = nominal_optics(sensor) if given is None else calibrated_optics(str(given), sensor)
    if background is None:
        return optics, grey_frame(optics)
    frame = read_rgb(background, field="--background")
    shape = (optics.geometry.height, optics.geometry.width, 3)
    if frame.shape != shape:
        raise ConfigError(
            f"background {background}: {frame.shape[1]} x {frame.shape[0]} px; the sensor's images "
            f"are {shape[1]} x {shape[0]} px",
            remedy="give the no-contact frame that `calibrate optics` took",
        )
    return optics, frame


def grey_frame(optics: OpticalCalibration) -> ImageArray:
    """Return an evenly grey frame in place of a recorded one without contact."""
    return np.full((optics.geometry.height, optics.geometry.width, 3), GREY_LEVEL, np.uint8)
