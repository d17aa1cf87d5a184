"""Which facet covers which pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.arrays import FloatArray

_EDGE_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelCover:
    """Every (pixel, facet) pair in which the facet covers the pixel's centre.

    Attributes:
        pixel: Row-major pixel index, shape [pair_count].
        facet: Facet index, shape [pair_count].
        barycentric: Coordinates in the facet, shape [pair_count, 3].
    """

    pixel: NDArray[np.int64]
    facet: NDArray[np.int64]
    barycentric: FloatArray


def rasterise(corners: FloatArray, *, height: int, width: int) -> PixelCover:
    """Find the pixels whose centres lie in each triangle.

    Args:
        corners: Column, row of the corners [px], shape [facet_count, 3, 2]; either orientation.
        height: Rows of the image.
        width: Columns of the image.
    """
    low = np.ceil(corners.min(axis=1) - _EDGE_TOLERANCE).astype(np.int64)
    high = np.floor(corners.max(axis=1) + _EDGE_TOLERANCE).astype(np.int64)
    low = np.maximum(low, 0)
    high = np.minimum(high, (width - 1, height - 1))
    extent = np.maximum(high - low + 1, 0)
    count = extent[:, 0] * extent[:, 1]
    facet = np.repeat(np.arange(len(corners)), count)
    first = np.cumsum(count) - count
    within = np.arange(len(facet)) - first[facet]
    column = low[facet, 0] + within % np.maximum(extent[facet, 0], 1)
    row = low[facet, 1] + within // np.maximum(extent[facet, 0], 1)

    origin = corners[:, 2]
    edge_u, edge_v = corners[:, 0] - origin, corners[:, 1] - origin
    area = edge_u[:, 0] * edge_v[:, 1] - edge_u[:, 1] * edge_v[:, 0]
    inverse_area = np.where(area == 0.0, 0.0, 1.0 / np.where(area == 0.0, 1.0, area))[facet]
    dx, dy = column - origin[facet, 0], row - origin[facet, 1]
    first_weight = (dx * edge_v[facet, 1] - dy * edge_v[facet, 0]) * inverse_area
    second_weight = (dy * edge_u[facet, 0] - dx * edge_u[facet, 1]) * inverse_area
    weights = np.stack([first_weight, second_weight, 1.0 - first_weight - second_weight], axis=1)
    inside = (weights.min(axis=1) >= -_EDGE_TOLERANCE) & (inverse_area != 0.0)
    return PixelCover(
        pixel=(row * width + column)[inside], facet=facet[inside], barycentric=weights[inside]
    )
