"""A dark skin seen through clear gel: the thinner the gel is pressed, the less light comes back.

The light that a layer scatters back grows towards a limit with its thickness (Kubelka and Munk
1931, to first order an exponential): a dent darkens fast at first and ever more slowly.
"""

from __future__ import annotations

import numpy as np

from drivers.emulators.plant.arrays import SingleArray
from drivers.emulators.plant.gel.relief import Relief, looked_up

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
