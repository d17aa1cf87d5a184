"""Gaussian blur of image planes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.optics.tilt import Float32Array

# Weights reach this many standard deviations, as they do in OpenCV for real images.
_REACH = 4.0


def gaussian_weights(sigma_px: float) -> Float32Array:
    """Return the weights of a pixel's neighbours along a row or a column, their sum 1.

    Args:
        sigma_px: Standard deviation [px]; 0 leaves the pixel alone.

    Returns:
        Shape [2 reach + 1], the pixel itself in the middle.
    """
    if not sigma_px > 0.0:
        return np.ones(1, dtype=np.float32)
    reach = round(2.0 * _REACH * sigma_px + 1.0) // 2
    distances = np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * (distances / sigma_px) ** 2)
    return np.asarray(weights / weights.sum(), dtype=np.float32)


def blurred(planes: NDArray[np.float32], weights: Float32Array) -> Float32Array:
    """Return planes weighed along rows and columns; the border's pixel is the mirror.

    Args:
        planes: Shape [count, height, width].
        weights: As ``gaussian_weights`` has them.
    """
    if len(weights) == 1:
        return planes
    return _weighed(_weighed(planes, weights, axis=2), weights, axis=1)


def _weighed(planes: Float32Array, weights: Float32Array, *, axis: int) -> Float32Array:
    reach, length = len(weights) // 2, planes.shape[axis]
    room = [(reach, reach) if k == axis else (0, 0) for k in range(planes.ndim)]
    wide = np.pad(planes, room, mode="reflect")

    def shifted(by: int) -> Float32Array:
        return wide[:, :, by : by + length] if axis == 2 else wide[:, by : by + length]

    total = weights[reach] * planes
    for k in range(reach):
        total += weights[k] * (shifted(k) + shifted(2 * reach - k))
    return np.asarray(total)
