"""Rigid indenters as data: solids whose lowest point is the origin of their own frame.

In the indenter's frame +z points up, away from the gel, and the body lies at z >= 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from sim.scene.triangle_surface import (
    MeshUnit,
    TriangleSurface,
    closed_surface,
    offset,
    read_triangles,
)
from tacauchy_rig.core.arrays import FloatArray, IntArray
from tacauchy_rig.core.errors import ConfigError

_SIZE_MIN_M = 0.1e-3
_SIZE_MAX_M = 0.5
# Of a mesh's least extent: the largest radius of its edges.
_EDGE_SHARE_MAX = 0.25
# Of a mesh's size: points of its lowest face may differ by so much in height.
_SAME_HEIGHT = 1e-6
_UPRIGHT, _ACUTE = 0.3, -0.26  # z of an upright face's normal; cosine between those of two faces


@dataclass(frozen=True, slots=True, kw_only=True)
class _Round:
    """A body that is round seen from above; its edge is that of a ball, if it states no other."""

    diameter_m: float  # [m]

    def __post_init__(self) -> None:
        if not self.diameter_m > 0.0:
            raise ConfigError(
                f"{type(self).__name__.lower()} diameter {self.diameter_m * 1e3:g} mm is not "
                "positive",
                remedy="give a length above 0 mm",
            )

    @property
    def radius_m(self) -> float:
        """Radius [m]."""
        return 0.5 * self.diameter_m

    @property
    def fillet_m(self) -> float:
        """Radius of the rounded edge [m]."""
        return self.radius_m

    def lower_surface(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the height of the underside above the tip [m], inf beside the body."""
        away_m, fillet_m = np.hypot(x, y), self.fillet_m
        inside = np.clip(away_m - (self.radius_m - fillet_m), 0.0, fillet_m)
        height = fillet_m - np.sqrt(np.maximum(fillet_m**2 - inside**2, 0.0))
        return np.where(away_m <= self.radius_m, height, np.inf)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cylinder(_Round):
    """Flat-ended punch along z; ``fillet_m`` is the radius of its end's edge [m], 0 if sharp."""

    fillet_m: float = 0.0

    def __post_init__(self) -> None:
        _Round.__post_init__(self)
        if not 0.0 <= self.fillet_m <= 0.5 * self.diameter_m:
            raise ConfigError(
                f"cylinder fillet {self.fillet_m * 1e3:g} mm is not between 0 and the radius "
                f"{self.diameter_m * 500:g} mm",
                remedy="give a fillet from 0 mm to the radius",
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class Sphere(_Round):
    """Ball whose lowest point is the origin."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Plane:
    """Unbounded flat plate."""

    def lower_surface(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return zero everywhere [m]."""
        return np.zeros(np.broadcast(x, y).shape)


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshIndenter:
    """A body bounded by triangles, its tip at the origin and z up, away from the gel.

    Two are equal when their triangles and their rounding are.
    """

    surface: TriangleSurface = field(repr=False, compare=False)  # its triangles [m]
    name: str = field(compare=False)
    content_hash: str  # first 16 hex digits of the SHA-256 of vertices and faces
    rounding_m: float = 0.0  # what lies so far from its triangles belongs to it [m]

    def lower_surface(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the height of the underside above the tip [m], inf beside the body."""
        return TurnedIndenter(indenter=self, rotation=np.eye(3)).lower_surface(x, y)

    @property
    def size_m(self) -> FloatArray:
        """Extents along x, y and z [m], shape [3]."""
        return np.asarray(np.ptp(self.surface.vertices, axis=0) + 2.0 * self.rounding_m)

    @property
    def blunted_m(self) -> float:
        """Height of its lowest point: what rounding took off a tip [m]."""
        return float(self.surface.vertices[:, 2].min()) - self.rounding_m

    @property
    def has_acute_corner(self) -> bool:
        """Two upright faces meet at less than 75 degrees."""
        normals = self.surface.face_normals
        normals = np.where(np.abs(normals[:, 2:]) < _UPRIGHT, normals, 0.0)
        around = normals[self.surface.neighbours]
        return bool(np.einsum("fi,fki->fk", normals, around).min() < _ACUTE)

    def with_edges(self, radius_m: float) -> MeshIndenter:
        """Return the body with outer edges and corners of at least this radius [m].

        Faces stay where they are, so that a pointed tip then lies above the origin.
        """
        inwards = radius_m - self.rounding_m
        if inwards <= 0.0:
            return self
        return _bounded(self, offset(self.surface, -inwards), 0.0, rounding_m=radius_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class IndenterSet:
    """Indenters of the environments of a batch."""

    bodies: tuple[Indenter, ...]  # all different indenters
    which: tuple[int, ...]  # index into ``bodies`` for each environment
    rounding_m: float = 0.0  # radius of sharp edges [m], which a mesh cannot follow


Indenter = Cylinder | Sphere | Plane | MeshIndenter


def grown(indenter: Indenter, by_m: float) -> Indenter:
    """Return what lies within a distance of a body [m], its tip lower by as much; a plate as is."""
    if isinstance(indenter, Cylinder):
        fillet = indenter.fillet_m + by_m
        return replace(indenter, diameter_m=indenter.diameter_m + 2.0 * by_m, fillet_m=fillet)
    if isinstance(indenter, Sphere):
        return replace(indenter, diameter_m=indenter.diameter_m + 2.0 * by_m)
    if isinstance(indenter, MeshIndenter):
        if indenter.rounding_m > 0.0:
            return _bounded(indenter, indenter.surface, by_m, rounding_m=indenter.rounding_m + by_m)
        return _bounded(indenter, offset(indenter.surface, by_m), by_m, rounding_m=0.0)
    return indenter


def _bounded(
    indenter: MeshIndenter, surface: TriangleSurface, lift_m: float, *, rounding_m: float
) -> MeshIndenter:
    """Return a body around other triangles, lifted."""
    moved = replace(surface, vertices=surface.vertices + np.array([0.0, 0.0, lift_m]))
    return replace(indenter, surface=moved, content_hash=moved.content_hash, rounding_m=rounding_m)


def describe(indenter: Indenter) -> str:
    """Return the indenter as the command line writes it, for example ``cylinder:diameter=5mm``."""
    if isinstance(indenter, Cylinder):
        fillet = f",fillet={indenter.fillet_m * 1e3:g}mm" if indenter.fillet_m else ""
        return f"cylinder:diameter={indenter.diameter_m * 1e3:g}mm{fillet}"
    if isinstance(indenter, Sphere):
        return f"sphere:diameter={indenter.diameter_m * 1e3:g}mm"
    if isinstance(indenter, MeshIndenter):
        return f"mesh:{indenter.name}"
    return "plane"


def mesh_indenter(vertices: FloatArray, faces: IntArray, *, name: str) -> MeshIndenter:
    """Make an indenter of vertices [n, 3] [m] and faces [n, 3], closed, their normals in or out.

    The tip is the lowest point of the mesh, or the middle of its lowest points where there are
    several, as in a flat face; the mesh is shifted so that it becomes the origin, and not turned.

    Raises:
        ConfigError: The surface is not closed, contradicts itself, or has no likely size.
    """
    extents_m = np.ptp(vertices, axis=0)
    if not _SIZE_MIN_M <= extents_m.max() <= _SIZE_MAX_M:
        sizes = " x ".join(f"{extent * 1e3:.4g}" for extent in extents_m)
        raise ConfigError(
            f"mesh {name} measures {sizes} mm, which is no indenter's size "
            f"({_SIZE_MIN_M * 1e3:g} mm to {_SIZE_MAX_M * 1e3:g} mm)",
            remedy=f"name the file's unit: mesh:FILE,unit={'|'.join(MeshUnit)}",
        )
    if not extents_m.min() > 0.0:
        raise ConfigError(f"mesh {name} is flat", remedy="export a solid body")
    near_m = _SAME_HEIGHT * float(np.linalg.norm(extents_m))
    lowest = vertices[vertices[:, 2] <= vertices[:, 2].min() + near_m]
    tip = np.append(0.5 * (lowest.min(axis=0) + lowest.max(axis=0))[:2], lowest[:, 2].min())
    surface = closed_surface(vertices - tip, faces, name=name)
    return MeshIndenter(surface=surface, name=name, content_hash=surface.content_hash)


def read_mesh_indenter(
    path: Path, *, unit: MeshUnit = MeshUnit.MILLIMETRE, edge_m: float = 0.0
) -> MeshIndenter:
    """Read an indenter from an STL or OBJ file; its +z points away from the gel.

    Args:
        edge_m: Radius of its outer edges and corners, which the file has sharp [m].

    Raises:
        ConfigError: The file cannot be read, or its triangles bound no body of a likely size, or
            none with such edges.
    """
    vertices, faces = read_triangles(path, unit)
    edge = f",edge={edge_m * 1e3:g}mm" if edge_m else ""
    found = mesh_indenter(vertices, faces, name=f"{path.name},unit={unit.value}{edge}")
    most_m = _EDGE_SHARE_MAX * float(found.size_m.min())
    if not 0.0 <= edge_m <= most_m:
        raise ConfigError(
            f"mesh {path.name}: an edge radius of {edge_m * 1e3:g} mm is not between 0 and "
            f"{most_m * 1e3:.3g} mm, a quarter of the body's least extent",
            remedy="give edge=0.1mm or the like, or leave it out",
        )
    rounded = found.with_edges(edge_m)
    return _bounded(rounded, rounded.surface, -rounded.blunted_m, rounding_m=edge_m)


_LENGTH_PER_DIAMETER = 2.0


@dataclass(frozen=True, kw_only=True)
class TurnedIndenter:
    """An indenter with its tip at the origin, turned about the tip."""

    indenter: Indenter
    rotation: FloatArray  # indenter frame to pad frame, shape [3, 3]

    def lower_surface(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the height of the underside above the tip [m], inf beside the body."""
        is_upright = np.array_equal(self.rotation, np.eye(3))
        if is_upright and not isinstance(self.indenter, MeshIndenter):
            return self.indenter.lower_surface(x, y)
        if isinstance(self.indenter, Plane):
            normal = self.rotation[:, 2]
            return np.asarray(-(normal[0] * x + normal[1] * y) / normal[2])
        if isinstance(self.indenter, Sphere):
            middle = self.rotation[:, 2] * self.indenter.radius_m
            beneath = self.indenter.lower_surface(x - middle[0], y - middle[1])
            return np.asarray(beneath + middle[2] - self.indenter.radius_m)
        return self._underside(x, y)

    @cached_property
    def _underside(self) -> Callable[[FloatArray, FloatArray], FloatArray]:
        from sim.scene.triangle_distance import underside  # noqa: PLC0415 - Warp, where rays are cast

        return underside(self._triangles(), rounding_m=getattr(self.indenter, "rounding_m", 0.0))

    def reach(self) -> tuple[FloatArray, FloatArray]:
        """Return the least and the greatest x and y of the body [m], shape [2] each."""
        if isinstance(self.indenter, Plane):
            return np.full(2, -np.inf), np.full(2, np.inf)
        if isinstance(self.indenter, Sphere):
            middle = self.rotation[:2, 2] * self.indenter.radius_m
            return middle - self.indenter.radius_m, middle + self.indenter.radius_m
        if isinstance(self.indenter, Cylinder):
            radius, fillet = self.indenter.radius_m, self.indenter.fillet_m
            axis, shares = self.rotation[:2, 2], np.sqrt(1.0 - self.rotation[:2, 2] ** 2)
            low, high = fillet * axis, _LENGTH_PER_DIAMETER * self.indenter.diameter_m * axis
            wide, end = fillet + (radius - fillet) * shares, radius * shares
            return np.minimum(low - wide, high - end), np.maximum(low + wide, high + end)
        plan = self._triangles().vertices[:, :2]
        rounding_m = self.indenter.rounding_m
        return plan.min(axis=0) - rounding_m, plan.max(axis=0) + rounding_m

    def _triangles(self) -> TriangleSurface:
        if isinstance(self.indenter, Cylinder):
            surface = closed_surface(*cylinder_triangles(self.indenter), name="cylinder")
        elif isinstance(self.indenter, Plane | Sphere):
            raise TypeError("planes and spheres are not made of triangles")
        else:
            surface = self.indenter.surface
        return replace(
            surface,
            vertices=surface.vertices @ self.rotation.T,
            face_normals=surface.face_normals @ self.rotation.T,
            vertex_normals=surface.vertex_normals @ self.rotation.T,
        )


def cylinder_triangles(
    cylinder: Cylinder, *, sectors: int = 256, fillet_rings: int = 8
) -> tuple[FloatArray, IntArray]:
    """Return vertices [m] and faces of a cylinder, twice as long as it is wide."""
    turn = np.linspace(0.0, 0.5 * np.pi, fillet_rings + 1 if cylinder.fillet_m > 0.0 else 1)
    radii = cylinder.radius_m - cylinder.fillet_m * (1.0 - np.sin(turn))
    heights = cylinder.fillet_m * (1.0 - np.cos(turn))
    length = _LENGTH_PER_DIAMETER * cylinder.diameter_m
    radii = np.concatenate([[0.0], radii, [cylinder.radius_m, 0.0]])
    return turned_triangles(radii, np.concatenate([[0.0], heights, [length, length]]), sectors)


def turned_triangles(
    radii: FloatArray, heights: FloatArray, sectors: int
) -> tuple[FloatArray, IntArray]:
    """Return vertices [m] and faces of a line turned about z; on the axis vertices coincide."""
    angles = 2.0 * np.pi * np.arange(sectors) / sectors
    x, y = (np.outer(radii, along) for along in (np.cos(angles), np.sin(angles)))
    rings = np.stack([x, y, np.broadcast_to(heights[:, None], x.shape)], axis=-1)
    return rings.reshape(-1, 3), ring_walls(np.arange(x.size, dtype=np.int32).reshape(x.shape))


def ring_walls(index: IntArray) -> IntArray:
    """Return the triangles between rings of nodes, shape [ring_count, sector_count]."""
    here, after = index, np.roll(index, -1, axis=1)
    halves = (here[:-1], after[:-1], after[1:]), (here[:-1], after[1:], here[1:])
    walls = [np.stack(corners, axis=-1).reshape(-1, 3) for corners in halves]
    return np.concatenate(walls).astype(np.int32)


def tilted(about_x_rad: float, about_y_rad: float) -> FloatArray:
    """Return the rotation about x, then about y, shape [3, 3]."""
    c, s = np.cos(about_x_rad), np.sin(about_x_rad)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    c, s = np.cos(about_y_rad), np.sin(about_y_rad)
    return np.asarray(np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]) @ about_x)
