"""A ball press as a calibration renders it: colours, shadows and blur, as in a replay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from sim.optics.calibrate.colours import Calibration
from sim.optics.calibrate.presses.ball_press import BallPress, Circle
from sim.optics.calibrate.presses.scene import PlacedPress, PressScene
from sim.optics.render.shadows import darkening
from sim.sensor.optics import ShadowCaster
from tacauchy_rig.core.arrays import Float32Array, FloatArray


def press_image(found: Calibration, circle: Circle) -> FloatArray:
    """Return a press over the no-contact frame [grey levels], shape [height, width, 3].

    Shadows and colours change the light, the lens blurs it, and the camera's response shows it.
    """
    scene, model = found.scene, found.model
    light = model.response.light(scene.background)
    change = scene.whole_image(model).light_change(circle).reshape(light.shape)
    change = change * model.gain(light)
    if found.shadows is not None:
        bulge, tilt = pressed_surface(scene, circle)
        change = change + darkening(found.shadows, bulge, tilt, scene.geometry).transpose(1, 2, 0)
    if found.blur_px > 0.0:
        change = np.asarray(cv2.GaussianBlur(change, (0, 0), found.blur_px), dtype=np.float64)
    return np.asarray(model.response.levels(light + change), dtype=np.float64)


def without_shadows(
    press: BallPress, circle: Circle, scene: PressScene, shadows: ShadowCaster | None
) -> BallPress:
    """Return the press with the light that its dent took away."""
    if shadows is None:
        return press
    bulge, tilt = pressed_surface(scene, circle)
    taken = darkening(shadows, bulge, tilt, scene.geometry)
    image = np.clip(np.rint(press.image - taken.transpose(1, 2, 0)), 0, 255)
    return replace(press, image=image.astype(np.uint8))


def lit_presses(presses: Sequence[BallPress], found: Calibration) -> list[PlacedPress]:
    """Return presses that a calibration was made of with the light that their dents took away."""
    return [
        replace(each, press=without_shadows(each.press, each.circle, found.scene, found.shadows))
        for each in found.placed(presses)
    ]


def pressed_surface(scene: PressScene, circle: Circle) -> tuple[Float32Array, Float32Array]:
    """Return indentation [m], shape [height, width], and tilt, shape [2, height, width]."""
    shape = (scene.geometry.height, scene.geometry.width)
    rows, columns = np.indices(shape).reshape(2, -1)
    gel = scene.surface(circle, columns, rows)
    return (
        gel.indentation_m.reshape(shape).astype(np.float32),
        gel.tilt.reshape(2, *shape).astype(np.float32),
    )
