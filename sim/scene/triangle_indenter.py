"""Rigid indenters from triangle meshes."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

import numpy as np

from sim.arrays import FloatArray, IntArray
from sim.scene.triangle_file import read_triangles
from sim.scene.triangle_surface import TriangleSurface, closed_surface
from sim.scene.underside import underside
from tacauchy_rig.errors import ConfigError

_SIZE_MIN_M = 0.1e-3
_SIZE_MAX_M = 0.5
_SAME_HEIGHT = 1e-6


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
        return _METRES[self]


_METRES = {
    MeshUnit.MICROMETRE: 1e-6,
    MeshUnit.MILLIMETRE: 1e-3,
    MeshUnit.CENTIMETRE: 1e-2,
    MeshUnit.METRE: 1.0,
    MeshUnit.INCH: 25.4e-3,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshIndenter:
    """A body bounded by triangles, its tip at the origin and z up, away from the gel.

    Two are equal when their triangles are.

    Attributes:
        surface: Its triangles [m].
        name: Where it came from, for reports.
        content_hash: First 16 hex digits of the SHA-256 of vertices and faces.
    """

    surface: TriangleSurface = field(repr=False, compare=False)
    name: str = field(compare=False)
    content_hash: str

    def lower_surface(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the height of the underside above the tip [m], inf beside the body."""
        return underside(self.surface, x, y)

    @property
    def size_m(self) -> FloatArray:
        """Extents along x, y and z [m], shape [3]."""
        return np.asarray(np.ptp(self.surface.vertices, axis=0))


def mesh_indenter(vertices: FloatArray, faces: IntArray, *, name: str) -> MeshIndenter:
    """Make an indenter of a closed surface, its normals in or out.

    The tip is the lowest point of the mesh, or the middle of its lowest points where there are
    several, as in a flat face; the mesh is shifted so that it becomes the origin, and not turned.

    Args:
        vertices: Corners [m], shape [vertex_count, 3].
        faces: Triangles, shape [face_count, 3].

    Raises:
        ConfigError: The surface is not closed, contradicts itself, or has no likely size.
    """
    _check_size(np.ptp(vertices, axis=0), name)
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    lowest = vertices[vertices[:, 2] <= vertices[:, 2].min() + _SAME_HEIGHT * size]
    tip = np.append(0.5 * (lowest.min(axis=0) + lowest.max(axis=0))[:2], lowest[:, 2].min())
    surface = closed_surface(vertices - tip, faces, name=name)
    digest = hashlib.sha256(surface.vertices.tobytes())
    digest.update(np.ascontiguousarray(surface.faces).tobytes())
    return MeshIndenter(surface=surface, name=name, content_hash=digest.hexdigest()[:16])


def read_mesh_indenter(path: Path, *, unit: MeshUnit = MeshUnit.MILLIMETRE) -> MeshIndenter:
    """Read an indenter from an STL or OBJ file; its +z points away from the gel.

    Raises:
        ConfigError: The file cannot be read, or its triangles bound no body of a likely size.
    """
    vertices, faces = read_triangles(path)
    return mesh_indenter(vertices * unit.metres, faces, name=f"{path.name},unit={unit.value}")


def _check_size(extents_m: FloatArray, name: str) -> None:
    largest = float(extents_m.max())
    if not _SIZE_MIN_M <= largest <= _SIZE_MAX_M:
        sizes = " x ".join(f"{extent * 1e3:.4g}" for extent in extents_m)
        raise ConfigError(
            f"mesh {name} measures {sizes} mm, which is no indenter's size "
            f"({_SIZE_MIN_M * 1e3:g} mm to {_SIZE_MAX_M * 1e3:g} mm)",
            remedy=f"name the file's unit: mesh:FILE,unit={'|'.join(MeshUnit)}",
        )
    if not float(extents_m.min()) > 0.0:
        raise ConfigError(f"mesh {name} is flat", remedy="export a solid body")
