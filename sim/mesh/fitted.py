"""Moves the vertices of a pad's mesh onto what they should lie on, where no element gets too flat.

FTetWild leaves the top anywhere within its envelope: at a press of 0.5 mm, 30 um would be several
per cent of the force. And it knows nothing of the rim of a punch: an element that the rim crosses
acts as if the punch were wider.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

from sim.mesh.elements import boundary_faces
from sim.mesh.tet_mesh import TetMesh, tet_volumes
from sim.scene.pad import Pad
from tacauchy_rig.core.arrays import FloatArray, IntArray

# Of its volume: what an element must keep when its vertices are moved.
_FLAT_SHARE = 0.2
_ROUNDS = 40
_ON_TOP_M = 1e-9


def with_top_fitted(mesh: TetMesh, pad: Pad, *, reach_m: float) -> TetMesh:
    """Move the vertices within ``reach_m`` [m] of the pad's top onto it."""
    outer, heights = _outer(mesh, pad)
    at = mesh.vertices[outer]
    near = (np.abs(at[:, 2] - heights) < reach_m) & (at[:, 2] > reach_m)
    wanted = mesh.vertices.copy()
    wanted[outer[near], 2] = heights[near]
    return replace(mesh, vertices=_moved(mesh, wanted))


def with_rim_fitted(mesh: TetMesh, pad: Pad, rim: FloatArray, *, reach_m: float) -> TetMesh:
    """Move the top's vertices near a rim onto it.

    Args:
        rim: Points of the rim, much closer to each other than the vertices [m], shape [count, 3];
            mirrored by the planes that mirror the mesh.
        reach_m: How far a vertex may be moved [m].
    """
    if not len(rim):
        return mesh
    outer, heights = _outer(mesh, pad)
    top = outer[np.abs(mesh.vertices[outer, 2] - heights) < _ON_TOP_M]
    distance, nearest = scipy.spatial.cKDTree(rim).query(mesh.vertices[top])
    near = distance < reach_m
    wanted = mesh.vertices.copy()
    wanted[top[near]] = rim[nearest[near]]
    mirrored = [mesh.symmetry.mirror_x, mesh.symmetry.mirror_y, False]
    wanted[:, mirrored] = np.abs(wanted[:, mirrored])
    wanted[mesh.symmetry.on_plane(mesh.vertices, reach_m)] = 0.0
    return replace(mesh, vertices=_moved(mesh, wanted))


def _outer(mesh: TetMesh, pad: Pad) -> tuple[IntArray, FloatArray]:
    """Return the vertices of the mesh's surface and the height of the pad there."""
    outer = np.unique(boundary_faces(mesh.tets)[0])
    return outer, pad.height_at(mesh.vertices[outer, 0], mesh.vertices[outer, 1])


def _moved(mesh: TetMesh, wanted: FloatArray) -> FloatArray:
    """Return the wanted vertices [m], without those moves that would flatten a tetrahedron."""
    least = _FLAT_SHARE * tet_volumes(mesh.vertices, mesh.tets)
    moved = wanted.copy()
    for _ in range(_ROUNDS):
        flat = mesh.tets[tet_volumes(moved, mesh.tets) < least]
        if not len(flat):
            return moved
        travel = np.linalg.norm(moved - mesh.vertices, axis=1)
        farthest = flat[np.arange(len(flat)), np.argmax(travel[flat], axis=1)]
        moved[farthest] = mesh.vertices[farthest]
    return mesh.vertices
