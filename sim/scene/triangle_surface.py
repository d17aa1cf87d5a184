"""Closed triangle surfaces: merged vertices, neighbours, normals, and their height from below.

The sign of the distance to a triangle surface is that of the pseudonormal at the nearest point: the
normal of a face, the sum of two faces' normals on an edge, and the normals weighted by the faces'
angles at a vertex (Baerentzen and Aanaes 2005).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace

import numpy as np
import scipy

from tacauchy_rig.core.arrays import FloatArray, IntArray
from tacauchy_rig.core.errors import ConfigError

# Vertices nearer to each other than this share of the surface's size are one.
_MERGE_SHARE = 1e-6
# Difference of unit normals that are the same.
_SAME_NORMAL = 1e-2
# Where a surface is moved outwards, normals that differ by less than about 25 degrees count as one
# (a share of the largest eigenvalue of the sum of n n^T), and no corner goes farther than so many
# times as far as its faces.
_ALIKE, _FARTHEST = 0.05, 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TriangleSurface:
    """A closed surface whose normals point outwards.

    Attributes:
        vertices: Shape [vertex_count, 3].
        faces: Counter-clockwise seen from outside, shape [face_count, 3]; edge k of a face runs
            from its corner k to the next.
        neighbours: The face across each edge, shape [face_count, 3].
        ring_starts: Where the faces of each vertex begin in ``ring_faces``, shape
            [vertex_count + 1].
        ring_faces: Faces around the vertices, shape [3 face_count].
        face_normals: Unit normals, shape [face_count, 3]; zero for a face without area.
        vertex_normals: Angle-weighted unit normals, shape [vertex_count, 3].
    """

    vertices: FloatArray
    faces: IntArray
    neighbours: IntArray
    ring_starts: IntArray
    ring_faces: IntArray
    face_normals: FloatArray
    vertex_normals: FloatArray

    @property
    def content_hash(self) -> str:
        """First 16 hex digits of the SHA-256 of vertices and faces."""
        digest = hashlib.sha256(self.vertices.tobytes())
        digest.update(np.ascontiguousarray(self.faces).tobytes())
        return digest.hexdigest()[:16]


def closed_surface(vertices: FloatArray, faces: IntArray, *, name: str) -> TriangleSurface:
    """Merge equal vertices, check that the named triangles close, and turn them outwards.

    Raises:
        ConfigError: The surface has holes, or neighbouring triangles contradict each other.
    """
    vertices, faces = _merged(vertices, faces)
    if not len(faces):
        raise ConfigError(f"{name}: every triangle is a point or a line", remedy="check its unit")
    neighbours = _neighbours(faces, len(vertices), name)
    a, b, c = (vertices[faces[:, k]] - vertices[faces[0, 0]] for k in range(3))
    if np.einsum("ij,ij->", a, np.cross(b, c)) < 0.0:
        faces, neighbours = faces[:, [0, 2, 1]], neighbours[:, [2, 1, 0]]
    face_normals, vertex_normals = _normals(vertices, faces)
    order = np.argsort(faces.reshape(-1), kind="stable")
    counts = np.bincount(faces.reshape(-1), minlength=len(vertices))
    return TriangleSurface(
        vertices=vertices,
        faces=faces,
        neighbours=neighbours,
        ring_starts=np.concatenate([[0], np.cumsum(counts)]).astype(np.int32),
        ring_faces=(order // 3).astype(np.int32),
        face_normals=face_normals,
        vertex_normals=vertex_normals,
    )


def _merged(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Make one of vertices that are the same up to rounding; drop faces that this collapses."""
    vertices, inverse = np.unique(vertices, axis=0, return_inverse=True)
    reach = _MERGE_SHARE * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    pairs = scipy.spatial.cKDTree(vertices).query_pairs(reach, output_type="ndarray")
    links = scipy.sparse.coo_matrix(
        (np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(vertices),) * 2
    )
    _, group = scipy.sparse.csgraph.connected_components(links, directed=False)
    _, first = np.unique(group, return_index=True)
    faces = np.asarray(group[inverse.reshape(-1)][faces], dtype=np.int32)
    whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    used, inverse = np.unique(faces[whole], return_inverse=True)
    return vertices[first][used], inverse.reshape(-1, 3).astype(np.int32)


def _neighbours(faces: IntArray, vertex_count: int, name: str) -> IntArray:
    start = faces.reshape(-1).astype(np.int64)
    end = np.roll(faces, -1, axis=1).reshape(-1).astype(np.int64)
    low, high = np.minimum(start, end), np.maximum(start, end)
    _, edge, uses = np.unique(low * vertex_count + high, return_inverse=True, return_counts=True)
    edge = edge.reshape(-1)
    forward = np.bincount(edge, weights=start < end)
    _refuse(
        int((uses == 1).sum()),
        f"{name} is not closed: {{}} of its {len(uses)} edges have a triangle on one side only",
        "close the holes (in CAD: export the solid, not a surface; or a mesh repair tool)",
    )
    _refuse(
        int((uses > 2).sum()),
        f"{name}: {{}} of its {len(uses)} edges carry more than two triangles",
        "export one solid without inner faces or doubled triangles",
    )
    _refuse(
        int((forward != 1).sum()),
        f"{name}: triangles face opposite ways across {{}} of its {len(uses)} edges",
        "make the normals consistent (a mesh repair tool's 'unify normals')",
    )
    order = np.argsort(edge, kind="stable").reshape(-1, 2)
    across = np.empty(len(edge), dtype=np.int32)
    across[order[:, 0]], across[order[:, 1]] = order[:, 1] // 3, order[:, 0] // 3
    return across.reshape(-1, 3)


def _refuse(count: int, message: str, remedy: str) -> None:
    if count:
        raise ConfigError(message.format(count), remedy=remedy)


def _normals(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, FloatArray]:
    corners = vertices[faces]
    ahead = np.roll(corners, -1, axis=1) - corners
    back = np.roll(corners, 1, axis=1) - corners
    area = np.cross(ahead[:, 0], back[:, 0])
    face_normals = _unit(area)
    angles = np.arctan2(
        np.linalg.norm(np.cross(ahead, back), axis=2), np.einsum("fki,fki->fk", ahead, back)
    )
    sums = np.zeros_like(vertices)
    np.add.at(sums, faces, angles[..., None] * face_normals[:, None])
    return face_normals, _unit(sums)


def _unit(vectors: FloatArray) -> FloatArray:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(length > 0.0, length, 1.0))


def offset(surface: TriangleSurface, by: float) -> TriangleSurface:
    """Return a surface whose faces have moved outwards, edges and corners staying sharp."""
    normals = np.repeat(surface.face_normals, 3, axis=0)
    around, total = np.zeros((len(surface.vertices), 3, 3)), np.zeros_like(surface.vertices)
    np.add.at(around, surface.faces.reshape(-1), normals[:, :, None] * normals[:, None, :])
    np.add.at(total, surface.faces.reshape(-1), normals)
    # Least squares of n . v = 1 over the faces around a vertex.
    ways = np.einsum("vij,vj->vi", np.linalg.pinv(around, _ALIKE, hermitian=True), total)
    ways /= np.maximum(1.0, np.linalg.norm(ways, axis=1) / _FARTHEST)[:, None]
    return replace(surface, vertices=surface.vertices + by * ways)


def is_mirrored(surface: TriangleSurface, axis: int) -> bool:
    """Return whether the plane through the origin across an axis mirrors a surface.

    Its vertices must be their own images, with their normals: weighted by angles, those are the
    same however a flat face is cut.
    """
    flip = np.where(np.arange(3) == axis, -1.0, 1.0)
    away, image = scipy.spatial.cKDTree(surface.vertices).query(surface.vertices * flip)
    turned = np.abs(surface.vertex_normals[image] - surface.vertex_normals * flip)
    size = float(np.ptp(surface.vertices, axis=0).max())
    return bool(away.max() <= _MERGE_SHARE * size and turned.max() <= _SAME_NORMAL)


def underside(surface: TriangleSurface, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the lowest height over points of the plan, of one shape together; inf beside it."""
    from sim.scene.triangle_rays import lowest_heights  # noqa: PLC0415 - Warp, where rays are cast

    x, y = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
    plan = np.column_stack([x.reshape(-1), y.reshape(-1)])
    return lowest_heights(surface, plan).reshape(x.shape)
