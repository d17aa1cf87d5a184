"""Shadows in the emulated world: what a dent hides from a light that grazes the gel."""

from __future__ import annotations

import numpy as np

from drivers.emulators.plant.arrays import SingleArray
from drivers.emulators.plant.relief import Relief, looked_up

_SAMPLES_M = tuple(float(s) for s in np.geomspace(6e-5, 4.5e-3, 22))
_PENUMBRA_M = 6e-5


def visible_share(
    relief: Relief, x: SingleArray, y: SingleArray, toward: tuple[SingleArray, ...]
) -> SingleArray:
    """Return how much of a light each point of the gel sees, 0 to 1.

    Args:
        relief: The press.
        x, y: Points of the gel [m].
        toward: Unit vectors to the light, third component away from the gel, each like ``x``.
    """
    own = looked_up(relief, relief.bulge, x, y)
    clearance = np.full_like(x, np.float32(1.0))
    for sample in _SAMPLES_M:
        step = np.float32(sample)
        there = looked_up(relief, relief.bulge, x + step * toward[0], y + step * toward[1])
        np.minimum(clearance, own + step * toward[2] - there, out=clearance)
    share: SingleArray = np.clip(
        np.float32(1.0) + clearance * np.float32(1.0 / _PENUMBRA_M), 0.0, 1.0
    )
    return share
