"""What takes light from the gel: shadows of a dent, the paint's texture, the depth of clear gel."""

from __future__ import annotations

import cv2
import numpy as np

from drivers.emulators.plant.arrays import SingleArray
from drivers.emulators.plant.relief import Relief, looked_up
from drivers.emulators.plant.view import View

_SAMPLES_M = tuple(float(s) for s in np.geomspace(1e-4, 4.5e-3, 20))
_STRIDE = 2  # of pixels: shadows are soft
_LIGHT_SPREAD = 0.09  # height of the light over its distance: shadows soften as they grow longer


def visible_share(
    relief: Relief, x: SingleArray, y: SingleArray, toward: tuple[SingleArray, ...]
) -> SingleArray:
    """Return how much of a light each point of the gel sees, 0 to 1.

    Args:
        relief: The press.
        x, y: Points of the gel, one a pixel [m], shape [height, width].
        toward: Unit vectors to the light, third component away from the gel, each like ``x``.
    """
    size = x.shape[::-1]
    x, y = x[::_STRIDE, ::_STRIDE], y[::_STRIDE, ::_STRIDE]
    toward = tuple(part[::_STRIDE, ::_STRIDE] for part in toward)
    own = looked_up(relief, relief.bulge, x, y)
    share = np.ones_like(x)
    for sample in _SAMPLES_M:
        step = np.float32(sample)
        there = looked_up(relief, relief.bulge, x + step * toward[0], y + step * toward[1])
        clearance = own + step * toward[2] - there
        softness = np.float32(_LIGHT_SPREAD * sample)
        np.minimum(share, np.float32(0.5) + clearance / softness, out=share)
    visible = cv2.resize(np.clip(share, 0.0, 1.0), size, interpolation=cv2.INTER_LINEAR)
    return np.asarray(visible, np.float32)


# Cells across the frame (columns, rows) and strength of each layer of noise.
_LAYERS = (((8, 6), 0.010), ((48, 36), 0.004), ((456, 342), 0.004))
_SMUDGE_COUNT = 14


def gel_texture(view: View, *, seed: int) -> SingleArray:
    """Return the paint's reflectance around one, shape [height, width]; the same at any size."""
    random = np.random.default_rng([seed, 2])
    texture = np.ones((view.height, view.width), np.float32)
    for (columns, rows), strength in _LAYERS:
        cells = random.standard_normal((rows, columns)).astype(np.float32)
        texture += strength * cv2.resize(
            cells, (view.width, view.height), interpolation=cv2.INTER_CUBIC
        )
    column = np.linspace(0.0, 1.0, view.width, dtype=np.float32)
    row = np.linspace(0.0, 1.0, view.height, dtype=np.float32)[:, None]
    for _ in range(_SMUDGE_COUNT):
        centre_x, centre_y = random.uniform(0.05, 0.95, 2)
        size_x, size_y = random.uniform(0.003, 0.010, 2)
        strength = random.uniform(0.01, 0.035)
        spot = ((column - centre_x) / size_x) ** 2 + ((row - centre_y) / (size_y * 4 / 3)) ** 2
        texture -= np.float32(strength) * np.exp(-0.5 * spot, dtype=np.float32)
    return texture


_LEVEL = 0.42  # linear light of the unloaded gel in the middle of the frame
_REMAINING = 0.22  # share of it that a gel pressed away would still send
_DEPTH_M = 0.62e-3  # over which the rest falls to 1/e


def scattered_light(relief: Relief | None, x: SingleArray, y: SingleArray) -> SingleArray:
    """Return the light that comes back from each point x, y [m] of the gel, same shape."""
    if relief is None:
        return np.full_like(x, _LEVEL)
    dent = np.maximum(looked_up(relief, relief.bulge, x, y), np.float32(0.0))
    falling = np.exp(dent * np.float32(-1.0 / _DEPTH_M))
    light: SingleArray = np.float32(_LEVEL) * (
        np.float32(_REMAINING) + np.float32(1.0 - _REMAINING) * falling
    )
    return light
