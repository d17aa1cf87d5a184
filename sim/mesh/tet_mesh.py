"""Tetrahedral meshes of a pad: the type, its checks and its numbers."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace

import numpy as np

from sim.arrays import FloatArray, IntArray
from sim.mesh.elements import FACES, boundary_faces
from sim.mesh.symmetry import MirrorSymmetry
from tacauchy_rig.errors import ConfigError

# The contact surface's edges are measured so near the pad's middle [m] and above this share of its
# height (paper, section IV-A).
_CENTRE_M = 2.5e-3
_UPPER_SHARE = 0.8


@dataclass(frozen=True, slots=True, kw_only=True)
class TetMesh:
    """Corner nodes and positively oriented tetrahedra of a pad.

    Attributes:
        vertices: Positions [m], shape [vertex_count, 3]; the clamped base lies at z = 0.
        tets: Shape [tet_count, 4].
        name: Where it came from, for reports.
        symmetry: The symmetry by which these tetrahedra stand for the whole pad.
        layers: Layer of each tetrahedron from the base upwards, shape [tet_count]; None where the
            mesh was made for a gel of one material.
        axis_m: Axis about which it was revolved, x and y [m]; None where it was not.
    """

    vertices: FloatArray
    tets: IntArray
    name: str
    symmetry: MirrorSymmetry = field(default_factory=MirrorSymmetry)
    layers: IntArray | None = None
    axis_m: tuple[float, float] | None = None

    @property
    def content_hash(self) -> str:
        """First 16 hex digits of the SHA-256 of vertices, tetrahedra and their layers."""
        digest = hashlib.sha256(np.ascontiguousarray(self.vertices).tobytes())
        digest.update(np.ascontiguousarray(self.tets).tobytes())
        if self.layers is not None:
            digest.update(np.ascontiguousarray(self.layers).tobytes())
        return digest.hexdigest()[:16]


def tet_volumes(vertices: FloatArray, tets: IntArray) -> FloatArray:
    """Return the volume of every tetrahedron [m^3], negative for one that is turned over."""
    corners = vertices[tets]
    return np.asarray(np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0)


def oriented(mesh: TetMesh) -> TetMesh:
    """Return a mesh with unused vertices dropped and every tetrahedron turned positive."""
    used, inverse = np.unique(mesh.tets, return_inverse=True)
    tets = inverse.reshape(-1, 4).astype(np.int32)
    vertices = np.ascontiguousarray(mesh.vertices[used], dtype=np.float64)
    negative = tet_volumes(vertices, tets) < 0.0
    tets[negative] = tets[negative][:, [0, 2, 1, 3]]
    return replace(mesh, vertices=vertices, tets=tets)


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
        dihedral_min_deg=_smallest_dihedral(mesh.vertices[mesh.tets]),
    )


def refuse_flat(mesh: TetMesh, least_rad: float) -> None:
    """Check a mesh's smallest angle between two faces of a tetrahedron.

    Raises:
        ConfigError: It is less than ``least_rad`` [rad].
    """
    found, asked = mesh_statistics(mesh).dihedral_min_deg, float(np.degrees(least_rad))
    if found < asked:
        raise ConfigError(
            f"mesh {mesh.name} has an angle of {found:.3g} deg between faces of a tetrahedron, "
            f"less than the {asked:.3g} deg asked for",
            remedy="lower stop_energy, which makes another mesh, or ask for less",
        )


def _centre_edge(vertices: FloatArray, faces: IntArray) -> float:
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    middles = vertices[edges].mean(axis=1)
    centre = np.hypot(middles[:, 0], middles[:, 1]) < _CENTRE_M
    kept = edges[centre & (middles[:, 2] > _UPPER_SHARE * vertices[:, 2].max())]
    lengths = np.linalg.norm(vertices[kept[:, 0]] - vertices[kept[:, 1]], axis=1)
    return float(lengths.mean()) if len(lengths) else float("nan")


def _smallest_dihedral(corners: FloatArray) -> float:
    normals = []
    for a, b, c in FACES:
        n = np.cross(corners[:, b] - corners[:, a], corners[:, c] - corners[:, a])
        normals.append(n / np.linalg.norm(n, axis=1, keepdims=True))
    cosines = [
        -np.einsum("ij,ij->i", normals[i], normals[j]) for i in range(4) for j in range(i + 1, 4)
    ]
    return float(np.degrees(np.arccos(np.clip(np.max(cosines), -1.0, 1.0))))
