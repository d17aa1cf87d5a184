"""The no-contact frame, averaged with what presses show of the gel around them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim.arrays import FloatArray
from sim.optics.calibrate.presses.ball_press import BallPress, Circle
from sim.optics.calibrate.presses.exposure import exposed
from sim.optics.calibrate.presses.samples import BEYOND_RIM, PressScene
from sim.optics.colour.photometric import PhotometricModel


def averaged_no_contact(
    presses: Sequence[BallPress],
    circles: Sequence[Circle],
    lights: Sequence[FloatArray],
    model: PhotometricModel,
    scene: PressScene,
) -> FloatArray:
    """Average the no-contact frame over all frames outside their contacts.

    One frame has a camera's noise of one or two grey levels in every pixel, which a rendering over
    it would repeat; each press shows most of the gel as well, once its light and skirt are off.

    Args:
        presses: The images.
        circles: Their contacts.
        lights: Their light, each of shape [3, 3].
        model: Explains the skirts.
        scene: Holds the frame that was taken without contact.

    Returns:
        Grey levels, shape [height, width, 3].
    """
    height, width = scene.background.shape[:2]
    rows, columns = np.mgrid[:height, :width]
    total = scene.background.astype(np.float64)
    count = np.ones((height, width, 3))
    pixels = scene.whole_image(model)
    for press, circle, light in zip(presses, circles, lights, strict=True):
        change = pixels.predict(circle).reshape(total.shape)
        level = press.image - scene.light_image(light) - change
        reach = BEYOND_RIM * circle.radius_px
        outside = np.hypot(columns - circle.x_px, rows - circle.y_px)[..., None] > reach
        told = outside & exposed(press.image)
        if scene.masked is not None:
            told &= ~scene.masked[..., None]
        total += np.where(told, level, 0.0)
        count += told
    return np.asarray(total / count)
