"""Pads as data: a box, a disc, a box with a domed top, or any closed surface on a flat base."""

from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim.scene.triangle_surface import MeshUnit, TriangleSurface, closed_surface, read_triangles
from tacauchy_rig.core.arrays import FloatArray, IntArray
from tacauchy_rig.core.errors import ConfigError

_ON_OUTLINE_M = 1e-12
_WIDTH_MIN_M = 2e-3
_WIDTH_MAX_M = 0.3
_HEIGHT_MIN_M = 0.2e-3
# Of the pad's height: what lies lower is of the base, and must be this share of what is seen from
# below.
_ON_BASE_SHARE = 1e-3
_BASE_SHARE_MIN = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class BoxPad:
    """Rectangular pad, x and y centred, base at z = 0, with a flat or domed top."""

    size_x_m: float  # extent in x [m]
    size_y_m: float  # extent in y [m]
    height_m: float  # thickness in the middle [m]
    dome_radius_x_m: float = np.inf  # radius of curvature of the top along x [m], inf for flat
    dome_radius_y_m: float = np.inf  # radius of curvature of the top along y [m], inf for flat

    def __post_init__(self) -> None:
        _check_lengths(self.size_x_m, self.size_y_m, self.height_m)
        corner = float(self.height_at(np.array(self.size_x_m / 2), np.array(self.size_y_m / 2)))
        if corner <= 0.1 * self.height_m:
            raise ConfigError(
                f"dome radii leave {corner * 1e3:.3g} mm of gel at the pad's corner",
                remedy="give larger dome radii or a thicker pad",
            )

    def height_at(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the height of the top at rest [m]."""
        along_x = self.height_m - 0.5 * x**2 / self.dome_radius_x_m
        return np.asarray(along_x - 0.5 * y**2 / self.dome_radius_y_m)

    def half_extents(self) -> tuple[float, float]:
        """Return half the extents in x and y [m]."""
        return self.size_x_m / 2.0, self.size_y_m / 2.0

    def sectors(
        self, centre: FloatArray, count: int, *, start_rad: float, end_rad: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return directions from a point, x and y [m], corners among them, and both ends [rad].

        They are about as many as ``count`` in a full turn. With each angle [rad] comes the distance
        to the outline [m].
        """
        half = np.array(self.half_extents())
        corners = np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]]) * half - centre
        turns = np.mod(np.arctan2(corners[:, 1], corners[:, 0]) - start_rad, 2.0 * np.pi)
        middles = np.arange(4) * 0.5 * np.pi
        span = end_rad - start_rad
        inner = [turn for turn in (*turns, *middles) if 1e-9 < turn < span - 1e-9]
        marks = start_rad + np.array([0.0, *sorted(inner), span])
        parts = [
            np.linspace(a, b, max(1, round(count * (b - a) / (2.0 * np.pi))), endpoint=False)
            for a, b in pairwise(marks)
        ]
        angles = np.append(np.concatenate(parts), marks[-1])
        direction = np.column_stack([np.cos(angles), np.sin(angles)])
        room = np.where(direction >= 0.0, half - centre, half + centre)
        reach = (room / np.maximum(np.abs(direction), 1e-12)).min(axis=1)
        return angles, reach

    def distance_to_outline(self, points: FloatArray) -> FloatArray:
        """Return how far inside points [count, 2] lie [m]; negative outside."""
        half = np.array(self.half_extents())
        return np.asarray((half - np.abs(points)).min(axis=1))


@dataclass(frozen=True, slots=True, kw_only=True)
class DiscPad:
    """Round pad with a flat top, base at z = 0."""

    radius_m: float
    height_m: float

    def __post_init__(self) -> None:
        _check_lengths(self.radius_m, self.height_m)

    def height_at(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the height of the top at rest [m]."""
        return np.full(np.broadcast(x, y).shape, self.height_m)

    def half_extents(self) -> tuple[float, float]:
        """Return half the extents in x and y [m]."""
        return self.radius_m, self.radius_m

    def sectors(
        self, centre: FloatArray, count: int, *, start_rad: float, end_rad: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return evenly spaced directions from a point; see ``BoxPad.sectors``."""
        part = max(1, round(count * (end_rad - start_rad) / (2.0 * np.pi)))
        angles = np.linspace(start_rad, end_rad, part + 1)
        along = np.cos(angles) * centre[0] + np.sin(angles) * centre[1]
        squared = self.radius_m**2 - float(centre @ centre)
        return angles, np.sqrt(along**2 + squared) - along

    def distance_to_outline(self, points: FloatArray) -> FloatArray:
        """Return how far inside points [count, 2] lie [m]; negative outside."""
        return np.asarray(self.radius_m - np.linalg.norm(points, axis=1))


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfacePad:
    """A pad bounded by triangles, base at z = 0, the middle of its extents at x = y = 0.

    Two are equal when their triangles are.
    """

    surface: TriangleSurface = field(repr=False, compare=False)  # its triangles [m]
    name: str = field(repr=False, compare=False)
    height_m: float  # of its highest point [m]
    content_hash: str  # first 16 hex digits of the SHA-256 of vertices and faces

    def height_at(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the height of the top at rest [m], -inf beside the pad."""
        from sim.scene.triangle_distance import underside  # noqa: PLC0415 - Warp, where rays are cast

        surface, mirror = self.surface, np.array([1.0, 1.0, -1.0])
        vertices, normals = surface.vertices * mirror, surface.face_normals * mirror
        return -underside(replace(surface, vertices=vertices, face_normals=normals))(x, y)

    def half_extents(self) -> tuple[float, float]:
        """Return half the extents in x and y [m]."""
        x, y, _ = 0.5 * np.ptp(self.surface.vertices, axis=0)
        return float(x), float(y)


ParametricPad = BoxPad | DiscPad
Pad = ParametricPad | SurfacePad


def covers(pad: Pad, points: FloatArray) -> NDArray[np.bool_]:
    """Return which points [count, 2] lie on a pad, its outline included."""
    if isinstance(pad, SurfacePad):
        return np.isfinite(pad.height_at(points[:, 0], points[:, 1]))
    return np.asarray(pad.distance_to_outline(points) >= -_ON_OUTLINE_M)


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
    vertices, faces = read_triangles(path, unit)
    return surface_pad(vertices, faces, name=f"{path.name},unit={unit.value}")


def surface_pad(vertices: FloatArray, faces: IntArray, *, name: str) -> SurfacePad:
    """Make a pad of vertices [n, 3] [m] and faces [n, 3], closed, their normals in or out.

    It is shifted and not turned.

    Raises:
        ConfigError: The surface is not closed, has no likely size, or stands on no flat base.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    _check_extents(high - low, name)
    middle = 0.5 * (low + high)
    at = vertices - np.array([middle[0], middle[1], low[2]])
    surface = closed_surface(at, faces, name=f"pad {name}")
    _check_base(surface, name)
    return SurfacePad(
        surface=surface,
        name=name,
        height_m=float(surface.vertices[:, 2].max()),
        content_hash=surface.content_hash,
    )


def _check_lengths(*lengths_m: float) -> None:
    for length in lengths_m:
        if not length > 0.0:
            raise ConfigError(
                f"pad length {length * 1e3:g} mm is not positive", remedy="give lengths above 0 mm"
            )


def _check_extents(extents_m: FloatArray, name: str) -> None:
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
