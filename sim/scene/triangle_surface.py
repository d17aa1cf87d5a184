"""Closed triangle surfaces: read from STL and OBJ files, merged, checked, with normals.

The sign of the distance to a triangle surface is that of the pseudonormal at the nearest point: the
normal of a face, the sum of two faces' normals on an edge, and the normals weighted by the faces'
angles at a vertex (Baerentzen and Aanaes 2005).
"""

import hashlib
import importlib
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from tacauchy_rig.core.arrays import FloatArray, IntArray
from tacauchy_rig.core.errors import ConfigError

_EXPORT = "export the part again, as binary STL"
_VTK = "vtkIOGeometry", "vtkFiltersCore"


class MeshUnit(StrEnum):
    """Unit of a mesh file's coordinates; the files themselves name none."""

    MICROMETRE = "um"
    MILLIMETRE = "mm"
    CENTIMETRE = "cm"
    METRE = "m"
    INCH = "in"

    @property
    def metres(self) -> float:
        """Length of the unit [m]."""
        return {"um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 25.4e-3}[self.value]


def read_triangles(path: Path, unit: MeshUnit) -> tuple[FloatArray, IntArray]:
    """Read vertices [m] and faces from a file of triangles; polygons of an OBJ are cut into them.

    Coordinates of an STL are of single precision, as its binary form has them. Corners of
    neighbouring triangles are not merged.

    Raises:
        ConfigError: The file is missing, damaged, empty, or of another kind.
    """
    kind = path.suffix.lower()
    if kind not in (".stl", ".obj"):
        raise ConfigError(
            f"{path}: {kind or 'a file without an ending'} is no kind of triangle file known here",
            remedy="give an .stl or .obj file",
        )
    if path.exists() and not path.is_file():
        raise ConfigError(f"{path} is no plain file", remedy="check the path")
    try:
        path.open("rb").close()
    except OSError as error:
        raise ConfigError(
            f"{path} cannot be read: {error.strerror}", remedy="check the path"
        ) from error
    vertices, faces = _read(path)
    if not len(faces):
        raise ConfigError(f"{path} holds no triangle", remedy=_EXPORT)
    if not np.isfinite(vertices).all():
        raise ConfigError(f"{path} has coordinates that are not finite", remedy=_EXPORT)
    return vertices * unit.metres, faces


def _read(path: Path) -> tuple[FloatArray, IntArray]:
    # Here, and not all of pyvista: its import takes longer than many a press.
    files, filters = (importlib.import_module(f"vtkmodules.{name}") for name in _VTK)
    kind = path.suffix[1:].upper()
    reader, errors = getattr(files, f"vtk{kind}Reader")(), []

    def note(_source: Any, _event: str, text: str) -> None:
        errors.append(text.partition("): ")[2].strip().rstrip("."))

    note.CallDataType = "string0"  # type: ignore[attr-defined]
    # Unobserved, VTK prints what is wrong with a file and goes on.
    for source in (reader, reader.GetExecutive()):
        source.AddObserver("ErrorEvent", note)
    reader.SetFileName(str(path))
    if kind == "STL":
        reader.MergingOff()
    reader.Update()
    if errors:
        raise ConfigError(
            f"{path} of {path.stat().st_size} bytes is damaged or no {kind} file: {errors[0]}",
            remedy=_EXPORT,
        )
    found = reader.GetOutput()
    corners, count = found.GetPolys().GetConnectivityArray(), found.GetNumberOfPoints()
    if corners.GetNumberOfValues() and corners.GetRange()[1] >= count:
        raise ConfigError(
            f"{path}: a corner names vertex {corners.GetRange()[1] + 1:g} of {count}",
            remedy=_EXPORT,
        )
    if not count:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32)
    cut = filters.vtkTriangleFilter()
    cut.SetInputData(found)
    cut.PassLinesOff()
    cut.PassVertsOff()
    cut.Update()
    points, faces = cut.GetOutput().GetPoints(), cut.GetOutput().GetPolys().GetConnectivityArray()
    return np.array(points.GetData(), dtype=np.float64), np.array(faces, np.int32).reshape(-1, 3)


# Vertices nearer to each other than this share of the surface's size are one.
_MERGE_SHARE = 1e-6
# Difference of unit normals that are the same.
_SAME_NORMAL = 1e-2
# Where a surface is moved, outwards or inwards: normals that differ by less than about 25 or 8
# degrees count as one (a share of the largest eigenvalue of the sum of n n^T), and no corner goes
# farther than so many times as far as its faces.
_OUTWARDS, _INWARDS = (0.05, 3.0), (0.005, 8.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class TriangleSurface:
    """A closed surface whose normals point outwards."""

    vertices: FloatArray  # shape [vertex_count, 3]
    # Counter-clockwise seen from outside, shape [face_count, 3]; edge k of a face runs from its
    # corner k to the next
    faces: IntArray
    neighbours: IntArray  # the face across each edge, shape [face_count, 3]
    ring_starts: IntArray  # where each vertex's faces begin in ``ring_faces``, [vertex_count + 1]
    ring_faces: IntArray  # faces around the vertices, shape [3 face_count]
    face_normals: FloatArray  # unit normals, shape [face_count, 3]; zero for a face without area
    vertex_normals: FloatArray  # angle-weighted unit normals, shape [vertex_count, 3]

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
    ends, shape = (pairs[:, 0], pairs[:, 1]), (len(vertices),) * 2
    links = scipy.sparse.coo_matrix((np.ones(len(pairs)), ends), shape=shape)
    _, group = scipy.sparse.csgraph.connected_components(links, directed=False)
    _, first = np.unique(group, return_index=True)
    faces = np.asarray(group[inverse.reshape(-1)][faces], dtype=np.int32)
    whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    used, faces = renumbered(faces[whole])
    return vertices[first][used], faces


def renumbered(cells: IntArray) -> tuple[IntArray, IntArray]:
    """Return the nodes that faces or tetrahedra use, and those in their numbering."""
    nodes, local = np.unique(cells, return_inverse=True)
    return nodes, local.reshape(cells.shape).astype(np.int32)


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
    face_normals = unit(area)
    sines = np.linalg.norm(np.cross(ahead, back), axis=2)
    angles = np.arctan2(sines, np.einsum("fki,fki->fk", ahead, back))
    sums = np.zeros_like(vertices)
    np.add.at(sums, faces, angles[..., None] * face_normals[:, None])
    return face_normals, unit(sums)


def unit(vectors: FloatArray) -> FloatArray:
    """Return vectors of length one, zero where there is none, shape [..., n]."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.where(length > 0.0, length, 1.0))


def offset(surface: TriangleSurface, by: float) -> TriangleSurface:
    """Return a surface whose faces have moved outwards, edges and corners staying sharp."""
    normals = np.repeat(surface.face_normals, 3, axis=0)
    around, total = np.zeros((len(surface.vertices), 3, 3)), np.zeros_like(surface.vertices)
    np.add.at(around, surface.faces.reshape(-1), normals[:, :, None] * normals[:, None, :])
    np.add.at(total, surface.faces.reshape(-1), normals)
    alike, farthest = _OUTWARDS if by > 0.0 else _INWARDS
    # Least squares of n . v = 1 over the faces around a vertex.
    ways = np.einsum("vij,vj->vi", np.linalg.pinv(around, alike, hermitian=True), total)
    ways /= np.maximum(1.0, np.linalg.norm(ways, axis=1) / farthest)[:, None]
    vertices = surface.vertices + by * ways
    # Faces beside a corner that did not go far enough have turned.
    of_faces, at_vertices = _normals(vertices, surface.faces)
    return replace(surface, vertices=vertices, face_normals=of_faces, vertex_normals=at_vertices)


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
