"""Pads whose surface comes from a triangle file: any shape on a flat base."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim.arrays import FloatArray, IntArray
from sim.scene.triangle_file import read_triangles
from sim.scene.triangle_indenter import MeshUnit
from sim.scene.triangle_surface import TriangleSurface, closed_surface
from sim.scene.underside import underside
from tacauchy_rig.errors import ConfigError

_WIDTH_MIN_M = 2e-3
_WIDTH_MAX_M = 0.3
_HEIGHT_MIN_M = 0.2e-3
_ON_BASE_SHARE = 1e-3
_BASE_SHARE_MIN = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfacePad:
    """A pad bounded by triangles, base at z = 0, the middle of its extents at x = y = 0.

    Two are equal when their triangles are.

    Attributes:
        surface: Its triangles [m].
        name: Where it came from, for reports.
        height_m: Of its highest point [m].
        content_hash: First 16 hex digits of the SHA-256 of vertices and faces.
    """

    surface: TriangleSurface = field(repr=False, compare=False)
    name: str = field(repr=False, compare=False)
    height_m: float
    content_hash: str

    def height_at(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the height of the top at rest [m], -inf beside the pad."""
        mirror = np.array([1.0, 1.0, -1.0])
        mirrored = replace(
            self.surface,
            vertices=self.surface.vertices * mirror,
            face_normals=self.surface.face_normals * mirror,
        )
        return -underside(mirrored, x, y)

    def half_extents(self) -> tuple[float, float]:
        """Return half the extents in x and y [m]."""
        x, y, _ = 0.5 * np.ptp(self.surface.vertices, axis=0)
        return float(x), float(y)

    def covers(self, points: FloatArray) -> NDArray[np.bool_]:
        """Return which points [count, 2] have gel above or below them."""
        return np.isfinite(self.height_at(points[:, 0], points[:, 1]))


def read_surface_pad(path: Path, *, unit: MeshUnit) -> SurfacePad:
    """Read a pad from an STL or OBJ file; its +z points out of the gel, towards the indenter.

    Raises:
        ConfigError: The file cannot be read, or its triangles bound no pad on a flat base.
    """
    if path.suffix.lower() in (".step", ".stp", ".iges", ".igs"):
        raise ConfigError(
            f"{path} holds exact surfaces, and a pad is read from triangles",
            remedy="export it as STL from the CAD program, with a chord error of about 1 um",
        )
    vertices, faces = read_triangles(path)
    return surface_pad(vertices * unit.metres, faces, name=f"{path.name},unit={unit.value}")


def surface_pad(vertices: FloatArray, faces: IntArray, *, name: str) -> SurfacePad:
    """Make a pad of a closed surface, its normals in or out; it is shifted and not turned.

    Args:
        vertices: Corners [m], shape [vertex_count, 3].
        faces: Triangles, shape [face_count, 3].

    Raises:
        ConfigError: The surface is not closed, has no likely size, or stands on no flat base.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    _check_size(high - low, name)
    middle = 0.5 * (low + high)
    at = vertices - np.array([middle[0], middle[1], low[2]])
    surface = closed_surface(at, faces, name=f"pad {name}")
    _check_base(surface, name)
    digest = hashlib.sha256(surface.vertices.tobytes())
    digest.update(np.ascontiguousarray(surface.faces).tobytes())
    return SurfacePad(
        surface=surface,
        name=name,
        height_m=float(surface.vertices[:, 2].max()),
        content_hash=digest.hexdigest()[:16],
    )


def _check_size(extents_m: FloatArray, name: str) -> None:
    width, height = extents_m[:2], float(extents_m[2])
    fits = width.min() >= _WIDTH_MIN_M and width.max() <= _WIDTH_MAX_M
    if not (fits and _HEIGHT_MIN_M <= height <= width.max()):
        sizes = " x ".join(f"{extent * 1e3:.4g}" for extent in extents_m)
        raise ConfigError(
            f"pad {name} measures {sizes} mm, which is no pad's size: {_WIDTH_MIN_M * 1e3:g} to "
            f"{_WIDTH_MAX_M * 1e3:g} mm wide, at least {_HEIGHT_MIN_M * 1e3:g} mm high and no "
            "higher than wide",
            remedy=f"name the file's unit ({', '.join(MeshUnit)}), or turn the part so that its "
            "z axis points out of the gel",
        )


def _check_base(surface: TriangleSurface, name: str) -> None:
    corners = surface.vertices[surface.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    seen = -0.5 * across[:, 2]
    height = float(surface.vertices[:, 2].max())
    on_base = (corners[..., 2] <= _ON_BASE_SHARE * height).all(axis=1)
    share = float(seen[on_base].sum() / seen[seen > 0.0].sum())
    if share < _BASE_SHARE_MIN:
        raise ConfigError(
            f"pad {name}: its lowest plane is {share:.0%} of what is seen from below, so that it "
            "stands on no flat base that could be clamped",
            remedy="turn the part so that its flat face lies down and its z axis points out of "
            "the gel",
        )
