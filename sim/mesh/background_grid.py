"""Tetrahedral grids for sizing fields, which fTetWild interpolates linearly on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.arrays import FloatArray, IntArray

_PATHS = (
    ((1, 0, 0), (1, 1, 0)),
    ((0, 1, 0), (1, 1, 0)),
    ((0, 1, 0), (0, 1, 1)),
    ((0, 0, 1), (0, 1, 1)),
    ((0, 0, 1), (1, 0, 1)),
    ((1, 0, 0), (1, 0, 1)),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Background:
    """A sizing field given at the points of a grid.

    Attributes:
        points: Shape [point_count, 3] [m].
        tets: Shape [tet_count, 4].
        edge_m: Target edge length at the points [m], shape [point_count].
    """

    points: FloatArray
    tets: IntArray
    edge_m: FloatArray


def tetrahedral_grid(axes: list[FloatArray]) -> tuple[FloatArray, IntArray]:
    """Return the points of a rectangular grid, and its cells cut into six tetrahedra each.

    Args:
        axes: Rising coordinates along x, y and z.
    """
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    counts = tuple(len(axis) for axis in axes)
    index = np.arange(len(points)).reshape(counts)
    corner = {
        (i, j, k): index[i : counts[0] - 1 + i, j : counts[1] - 1 + j, k : counts[2] - 1 + k]
        for i in (0, 1)
        for j in (0, 1)
        for k in (0, 1)
    }
    tets = [
        np.stack([corner[0, 0, 0], corner[a], corner[b], corner[1, 1, 1]], axis=-1).reshape(-1, 4)
        for a, b in _PATHS
    ]
    return points, np.concatenate(tets).astype(np.int32)
