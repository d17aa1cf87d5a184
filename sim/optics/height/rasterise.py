"""Which facet covers which pixel, and a height between its corners that is smooth (C1).

The reduced Clough-Tocher element: each triangle is cut at its centroid into three cubic Bezier
patches fixed by height and slope at the corners; the slope across an edge varies linearly along
it, so neighbours meet with one slope. Reference: Clough and Tocher 1965; Lai and Schumaker, Spline
Functions on Triangulations, 2007, section 6.3. Quadratic surfaces are reproduced exactly.
"""

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


_NEXT = np.array([1, 2, 0])


class CloughTocherPatches:
    """Bezier coefficients of all triangles.

    Args:
        corners: x, y of the corners [m], shape [facet_count, 3, 2].
        heights: z at the corners [m], shape [facet_count, 3].
        gradients: dz/dx, dz/dy at the corners, shape [facet_count, 3, 2].
    """

    def __init__(self, corners: FloatArray, heights: FloatArray, gradients: FloatArray) -> None:
        following = corners[:, _NEXT]
        along = following - corners
        toward_centroid = corners.mean(axis=1, keepdims=True) - corners
        end_slope = gradients[:, _NEXT]
        self._corner = heights
        self._after = heights + _dot(gradients, along) / 3.0
        self._before_next = heights[:, _NEXT] - _dot(end_slope, along) / 3.0
        self._inward = heights + _dot(gradients, toward_centroid) / 3.0
        foot = _dot(toward_centroid, along) / np.maximum(_dot(along, along), 1e-30)
        self._edge = self._edge_coefficient(foot)
        self._spoke = (self._inward + self._edge + self._edge[:, [2, 0, 1]]) / 3.0
        self._centroid = self._spoke.mean(axis=1)

    def _edge_coefficient(self, foot: FloatArray) -> FloatArray:
        """Make the derivative along the edge's normal linear; ``foot`` is the normal's foot."""
        near, far = 1.0 - foot, foot
        start, after, before = self._corner, self._after, self._before_next
        end = self._corner[:, _NEXT]
        at_start = self._inward - near * start - far * after
        at_end = self._inward[:, _NEXT] - near * before - far * end
        return np.asarray(near * after + far * before + 0.5 * (at_start + at_end))

    def evaluate(self, facet: NDArray[np.int64], barycentric: FloatArray) -> FloatArray:
        """Return heights [m] at points given by facet index [n] and coordinates [n, 3]."""
        smallest = np.argmin(barycentric, axis=1)
        i = (smallest + 1) % 3
        j = (smallest + 2) % 3
        rows = np.arange(len(facet))
        centre = 3.0 * barycentric[rows, smallest]
        a = barycentric[rows, i] - barycentric[rows, smallest]
        b = barycentric[rows, j] - barycentric[rows, smallest]
        c = centre
        f = facet
        return np.asarray(
            a**3 * self._corner[f, i]
            + b**3 * self._corner[f, j]
            + c**3 * self._centroid[f]
            + 3.0 * a * a * (b * self._after[f, i] + c * self._inward[f, i])
            + 3.0 * b * b * (a * self._before_next[f, i] + c * self._inward[f, j])
            + 3.0 * c * c * (a * self._spoke[f, i] + b * self._spoke[f, j])
            + 6.0 * a * b * c * self._edge[f, i]
        )


def _dot(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.asarray(np.sum(first * second, axis=-1))
