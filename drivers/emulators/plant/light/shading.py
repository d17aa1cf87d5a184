"""Shadows in the emulated world: what a dent hides from a light that grazes the gel."""

from __future__ import annotations

import cv2
import numpy as np

from drivers.emulators.plant.arrays import SingleArray
from drivers.emulators.plant.gel.relief import Relief, looked_up

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
