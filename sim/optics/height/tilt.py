"""Tilt of the gel's surface per pixel: the lateral part of its unit normal."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float32Array = NDArray[np.float32]


def bounded_tilt(tilt: NDArray[np.floating], limit: float) -> NDArray[np.floating]:
    """Return tilts no steeper than a limit, in their own direction; shape [2, ...]."""
    squared = tilt[0] * tilt[0] + tilt[1] * tilt[1]
    if squared.size == 0 or squared.max() <= limit * limit:
        return tilt
    bound = tilt.dtype.type(limit)
    return np.asarray(tilt * (bound / np.maximum(np.sqrt(squared), bound)))
