"""Moves a mesh's top onto the pad's: fTetWild leaves it anywhere within its envelope.

At a press of 0.5 mm an envelope of 30 um would be an error of several per cent of the force.
"""

from __future__ import annotations

import numpy as np

from sim.arrays import FloatArray, IntArray
from sim.elements import boundary_faces
from sim.pad import Pad

_FLAT_SHARE = 0.2
_ROUNDS = 5


def fitted_top(vertices: FloatArray, tets: IntArray, pad: Pad, *, reach_m: float) -> FloatArray:
    """Return vertices [vertex_count, 3] of which those near the pad's top lie on it [m].

    Args:
        tets: Positively oriented.
        reach_m: How far a vertex may be moved [m].
    """
    outer = np.unique(boundary_faces(tets)[0])
    heights = pad.height_at(vertices[outer, 0], vertices[outer, 1])
    near = (np.abs(vertices[outer, 2] - heights) < reach_m) & (vertices[outer, 2] > reach_m)
    moved = vertices.copy()
    moved[outer[near], 2] = heights[near]
    # A flat tetrahedron is worse than a vertex that stays some micrometres off.
    before = _volumes(vertices, tets)
    for _ in range(_ROUNDS):
        flat = _volumes(moved, tets) < _FLAT_SHARE * before
        if not flat.any():
            return moved
        kept = np.unique(tets[flat])
        moved[kept] = vertices[kept]
    return vertices


def _volumes(vertices: FloatArray, tets: IntArray) -> FloatArray:
    corners = vertices[tets]
    return np.asarray(np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0)
