"""All that ball presses tell of a sensor's optics: colours, shadows where it has any, blur."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from sim.optics.calibrate.colours import Calibration, calibrate_optics, fit_model
from sim.optics.calibrate.fit.photometric_fit import lowest_place
from sim.optics.calibrate.press_image import lit_presses
from sim.optics.calibrate.presses.ball_press import BallPress
from sim.optics.calibrate.presses.light import exposed
from sim.optics.calibrate.presses.scene import PlacedPress, PredictedPixels, PressScene
from sim.optics.calibrate.shadow_fit import calibrate_with_shadows
from sim.sensor.optics import ShadowCaster
from tacauchy_rig.core.arrays import FloatArray

_BLUR_TURNS = 4
_SETTLED_PX = 0.05
BLUR_PX = "blur_px"  # its name in a calibration's provenance
_TRIED_PX = np.arange(0.0, 2.26, 0.25)
_MARGIN_PX = 10
_REACH = 1.4  # radii of the contact that are looked at


def calibrate_presses(
    presses: Sequence[BallPress],
    scene: PressScene,
    shadows: ShadowCaster | None,
    *,
    blurred: bool = True,
) -> Calibration:
    """Fit colours, shadows where the sensor's file says that there are any, and the blur.

    Args:
        shadows: Lamps of the sensor's file that cast some; None is a sensor that shows none.
        blurred: Find the camera's blur; who only wants the circles is spared that.

    Raises:
        ConfigError: As ``calibrate_optics``.
    """
    if shadows is None:
        found = calibrate_optics(presses, scene)
    else:
        found = calibrate_with_shadows(presses, scene, shadows)
    if not blurred:
        return found
    placed = lit_presses(presses, found)
    found = replace(found, blur_px=fit_blur(placed, found))
    for _ in range(_BLUR_TURNS):
        blur_px = found.blur_px
        if blur_px == 0.0:
            break
        # The colours once more, to the gel as the blur shows it: or they take a part of it.
        found = replace(found, model=fit_model(placed, found.scene, found.model, blur_px=blur_px))
        found = replace(found, blur_px=fit_blur(placed, found))
        if abs(found.blur_px - blur_px) < _SETTLED_PX:
            break
    return found


def fit_blur(placed: Sequence[PlacedPress], found: Calibration) -> float:
    """Return the standard deviation of the blur that explains the presses best [px].

    Lens, sensor and JPEG spread each point of the gel over its neighbours; a ball shows it where
    its contact ends. The model, fitted to the same images, takes up a part of a blur, and blur a
    part of the model's error: this is what makes renderings agree best, no measurement of a lens.
    """
    misfit = np.zeros(len(_TRIED_PX))
    scene = found.scene
    for each in placed:
        press, circle = each.press, each.circle
        reach = _REACH * circle.radius_px + _MARGIN_PX
        window = tuple(
            slice(max(0, int(middle - reach)), int(middle + reach) + 2)
            for middle in (circle.y_px, circle.x_px)
        )
        rows, columns = np.indices(press.image.shape[:2])[:, *window]
        near = circle.distance(columns, rows) < _REACH * circle.radius_px
        image = press.image[window]
        told = (near & scene.bare[window])[..., None] & exposed(image)
        seen = image - scene.background[window] - scene.light_image(each.light)[window]
        pixels = PredictedPixels(scene, found.model, columns.ravel(), rows.ravel())
        sharp = pixels.predict(circle).reshape(seen.shape)
        misfit += [np.abs(seen - _blurred(sharp, s))[told].sum() for s in _TRIED_PX]
    # A blur beyond those tried is larger than cameras have: something else is wrong then.
    at_an_end = int(np.argmin(misfit)) in (0, len(misfit) - 1)
    return 0.0 if at_an_end else lowest_place(_TRIED_PX, misfit)


def _blurred(image: FloatArray, sigma_px: float) -> FloatArray:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px)) if sigma_px > 0.0 else image
