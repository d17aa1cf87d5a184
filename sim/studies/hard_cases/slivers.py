"""Flat tetrahedra on purpose: every other interior node is pushed into one of its neighbours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim.arrays import FloatArray, IntArray
from sim.mesh.elements import boundary_faces
from sim.mesh.tet_mesh import TetMesh, mesh_statistics


def with_slivers(mesh: TetMesh, *, dihedral_deg: float, radius_m: float = np.inf) -> TetMesh:
    """Flatten one tetrahedron at every other interior node, those with no edge in common.

    Args:
        dihedral_deg: Smallest angle between two faces that each of them gets [deg].
        radius_m: Only at nodes nearer to the z axis than this [m].
    """
    vertices = mesh.vertices.copy()
    inner = np.setdiff1d(np.arange(len(vertices)), np.unique(boundary_faces(mesh.tets)[0]))
    inner = inner[np.hypot(*vertices[inner, :2].T) < radius_m]
    taken: set[int] = set()
    for node in inner.tolist():
        star = mesh.tets[np.any(mesh.tets == node, axis=1)]
        if node not in taken:
            vertices[node] = _flattening_place(vertices, star, node, dihedral_deg)
            taken.update(star.reshape(-1).tolist())
    name = f"{mesh.name}, slivers of {dihedral_deg:g} deg"
    return replace(mesh, vertices=vertices, name=name)


def sliver_count(mesh: TetMesh, *, below_deg: float) -> int:
    """Return how many tetrahedra have an angle between two faces below a limit."""
    return sum(_smallest_angle(mesh.vertices, tet[None]) < below_deg for tet in mesh.tets)


def _flattening_place(
    vertices: FloatArray, star: IntArray, node: int, dihedral_deg: float
) -> FloatArray:
    """Return where a node makes a tetrahedron of its star as flat as asked, by bisection.

    It goes towards the middle of the first one's opposite face.
    """
    start = vertices[node].copy()
    opposite = star[0][star[0] != node]
    goal = vertices[opposite].mean(axis=0)
    moved, low, high = vertices.copy(), 0.0, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        moved[node] = start + middle * (goal - start)
        if _smallest_angle(moved, star) > dihedral_deg:
            low = middle
        else:
            high = middle
    return np.asarray(start + low * (goal - start))


def _smallest_angle(vertices: FloatArray, tets: IntArray) -> float:
    part = TetMesh(vertices=vertices, tets=tets, name="star")
    return mesh_statistics(part).dihedral_min_deg
