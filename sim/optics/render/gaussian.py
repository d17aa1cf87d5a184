"""Gaussian blur of image planes."""

from __future__ import annotations

import numpy as np

from sim.optics.height.tilt import Float32Array

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


def blurred(planes: Float32Array, weights: Float32Array) -> Float32Array:
    """Return planes weighed along rows and columns; the border's pixel is the mirror.

    Args:
        planes: Shape [count, height, width].
        weights: As ``gaussian_weights`` has them.
    """
    reach = len(weights) // 2
    wide = np.pad(planes, ((0, 0), (reach, reach), (reach, reach)), mode="reflect")
    return inner_blurred(wide, weights)


def inner_blurred(wide: Float32Array, weights: Float32Array) -> Float32Array:
    """Return planes weighed along rows and columns, without the border that they reach over.

    Args:
        wide: Shape [count, height + 2 reach, width + 2 reach].
        weights: As ``gaussian_weights`` has them, shape [2 reach + 1].

    Returns:
        Shape [count, height, width].
    """
    reach = len(weights) // 2
    height, width = wide.shape[1] - 2 * reach, wide.shape[2] - 2 * reach
    down = weights[reach] * wide[:, reach : reach + height]
    pair = np.empty_like(down)
    for k in range(reach):
        other = 2 * reach - k
        np.add(wide[:, k : k + height], wide[:, other : other + height], out=pair)
        pair *= weights[k]
        down += pair
    total = weights[reach] * down[:, :, reach : reach + width]
    pair = np.empty_like(total)
    for k in range(reach):
        other = 2 * reach - k
        np.add(down[:, :, k : k + width], down[:, :, other : other + width], out=pair)
        pair *= weights[k]
        total += pair
    return np.asarray(total)
