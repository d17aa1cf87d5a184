"""The numbers of the paper's mesh table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.mesh.elements import boundary_faces
from sim.mesh.tet_mesh import TetMesh, smallest_dihedral_deg
from tacauchy_rig.core.arrays import FloatArray, IntArray

# The contact surface's edges are measured so near the pad's middle [m] and above this share of its
# height (paper, section IV-A).
_CENTRE_M = 2.5e-3
_UPPER_SHARE = 0.8


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshStatistics:
    """The numbers of the paper's mesh table.

    Attributes:
        centre_edge_m: Mean length of the contact surface's edges within 2.5 mm of the middle.
        dihedral_min_deg: Smallest angle between two faces of a tetrahedron.
    """

    tet_count: int
    vertex_count: int
    surface_vertex_count: int
    surface_face_count: int
    centre_edge_m: float
    dihedral_min_deg: float


def mesh_statistics(mesh: TetMesh) -> MeshStatistics:
    """Measure a mesh as the paper's section IV-A does."""
    faces, _ = boundary_faces(mesh.tets)
    return MeshStatistics(
        tet_count=len(mesh.tets),
        vertex_count=len(mesh.vertices),
        surface_vertex_count=len(np.unique(faces)),
        surface_face_count=len(faces),
        centre_edge_m=_centre_edge(mesh.vertices, faces),
        dihedral_min_deg=smallest_dihedral_deg(mesh),
    )


def _centre_edge(vertices: FloatArray, faces: IntArray) -> float:
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    middles = vertices[edges].mean(axis=1)
    centre = np.hypot(middles[:, 0], middles[:, 1]) < _CENTRE_M
    kept = edges[centre & (middles[:, 2] > _UPPER_SHARE * vertices[:, 2].max())]
    lengths = np.linalg.norm(vertices[kept[:, 0]] - vertices[kept[:, 1]], axis=1)
    return float(lengths.mean()) if len(lengths) else float("nan")
