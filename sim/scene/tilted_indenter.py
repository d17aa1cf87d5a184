"""An indenter as it comes down, tilted: its underside and how far it reaches, seen from above."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sim.scene.indenter import Cylinder, Indenter, Plane, Sphere
from sim.scene.triangle_surface import TriangleSurface, closed_surface, underside
from tacauchy_rig.core.arrays import FloatArray, IntArray

_SECTORS = 256
_FILLET_RINGS = 8
_LENGTH_PER_DIAMETER = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnedIndenter:
    """An indenter with its tip at the origin, turned about the tip.

    Attributes:
        rotation: Indenter frame to pad frame, shape [3, 3].
    """

    indenter: Indenter
    rotation: FloatArray

    def lower_surface(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the height of the underside above the tip [m], inf beside the body."""
        if np.array_equal(self.rotation, np.eye(3)):
            return self.indenter.lower_surface(x, y)
        if isinstance(self.indenter, Plane):
            normal = self.rotation[:, 2]
            return np.asarray(-(normal[0] * x + normal[1] * y) / normal[2])
        if isinstance(self.indenter, Sphere):
            middle = self.rotation[:, 2] * self.indenter.radius_m
            beneath = self.indenter.lower_surface(x - middle[0], y - middle[1])
            return np.asarray(beneath + middle[2] - self.indenter.radius_m)
        return underside(self._triangles(), x, y)

    def reach(self) -> tuple[FloatArray, FloatArray]:
        """Return the least and the greatest x and y of the body [m], shape [2] each."""
        if isinstance(self.indenter, Plane):
            return np.full(2, -np.inf), np.full(2, np.inf)
        if isinstance(self.indenter, Sphere):
            middle = self.rotation[:2, 2] * self.indenter.radius_m
            return middle - self.indenter.radius_m, middle + self.indenter.radius_m
        plan = self._triangles().vertices[:, :2]
        return plan.min(axis=0), plan.max(axis=0)

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
    cylinder: Cylinder, *, sectors: int = _SECTORS, fillet_rings: int = _FILLET_RINGS
) -> tuple[FloatArray, IntArray]:
    """Return vertices [m] and faces of a cylinder, twice as long as it is wide."""
    turn = np.linspace(0.0, 0.5 * np.pi, fillet_rings + 1 if cylinder.fillet_m > 0.0 else 1)
    radii = cylinder.radius_m - cylinder.fillet_m * (1.0 - np.sin(turn))
    heights = cylinder.fillet_m * (1.0 - np.cos(turn))
    length = _LENGTH_PER_DIAMETER * cylinder.diameter_m
    radii, heights = np.append(radii, cylinder.radius_m), np.append(heights, length)
    angles = 2.0 * np.pi * np.arange(sectors) / sectors
    rings = np.stack(
        [
            radii[:, None] * np.cos(angles),
            radii[:, None] * np.sin(angles),
            np.broadcast_to(heights[:, None], (len(radii), sectors)),
        ],
        axis=-1,
    )
    vertices = np.concatenate([[[0.0, 0.0, 0.0], [0.0, 0.0, length]], rings.reshape(-1, 3)])
    index = np.arange(2, 2 + len(radii) * sectors, dtype=np.int32).reshape(-1, sectors)
    bottom = np.column_stack([np.zeros(sectors, dtype=int), np.roll(index[0], -1), index[0]])
    top = np.column_stack([np.ones(sectors, dtype=int), index[-1], np.roll(index[-1], -1)])
    return vertices, np.concatenate([bottom, top, ring_walls(index)]).astype(np.int32)


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
