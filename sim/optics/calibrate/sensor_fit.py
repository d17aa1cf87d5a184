"""All that ball presses tell of a sensor's optics: colours, shadows where it has any, blur."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from sim.arrays import IntArray
from sim.optics.calibrate.blur import fit_blur
from sim.optics.calibrate.colours import Calibration, calibrate_optics, fit_model
from sim.optics.calibrate.photometric_fit import BALL_EXPONENTS
from sim.optics.calibrate.press_image import without_shadows
from sim.optics.calibrate.presses.ball_press import BallPress
from sim.optics.calibrate.presses.samples import PressScene
from sim.optics.calibrate.shadow_fit import calibrate_with_shadows
from sim.optics.colour.grey_depth import GREY_EXPONENTS
from sim.optics.colour.nominal import shadows_of
from sim.sensor.sensor import Sensor
from sim.sensor.tables import OpticsKind

_BLUR_TURNS = 4
_SETTLED_PX = 0.05


def calibrate_presses(
    presses: Sequence[BallPress], scene: PressScene, sensor: Sensor, *, blurred: bool = True
) -> Calibration:
    """Fit colours, shadows where the sensor's file says that there are any, and the blur.

    Args:
        presses: Images with labelled circles.
        scene: Camera, no-contact frame and gel.
        sensor: Says how the colours are modelled and which lamps cast shadows.
        blurred: Find the camera's blur; who only wants the circles is spared that.

    Raises:
        ConfigError: As ``calibrate_optics``.
    """
    nominal, exponents = shadows_of(sensor), exponents_for(sensor)
    if nominal is None:
        found = calibrate_optics(presses, scene, exponents=exponents)
    else:
        found = calibrate_with_shadows(presses, scene, nominal, exponents=exponents)
    if not blurred:
        return found
    lit = [
        without_shadows(press, circle, found.scene, found.shadows)
        for press, circle in zip(presses, found.circles, strict=True)
    ]
    return _sharpened(lit, found, exponents)


def _sharpened(
    presses: Sequence[BallPress], found: Calibration, exponents: IntArray
) -> Calibration:
    """Fit the blur, and the colours once more to the gel as the blur shows it.

    Without that the colours take a part of the blur for the gel's own.
    """
    found = replace(found, blur_px=fit_blur(presses, found))
    for _ in range(_BLUR_TURNS):
        blur_px = found.blur_px
        if blur_px == 0.0:
            break
        model = fit_model(
            presses,
            found.circles,
            found.lights,
            found.scene,
            exponents,
            found.model,
            blur_px=blur_px,
        )
        found = replace(found, model=model)
        found = replace(found, blur_px=fit_blur(presses, found))
        if abs(found.blur_px - blur_px) < _SETTLED_PX:
            break
    return found


def exponents_for(sensor: Sensor) -> IntArray:
    """Return the terms that a sensor's optics are fitted with."""
    return GREY_EXPONENTS if sensor.optics.kind is OpticsKind.GREY_DEPTH else BALL_EXPONENTS
