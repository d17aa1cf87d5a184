"""Rigid tips of revolution as distance functions, lowest point at the origin, body at z >= 0."""

from dataclasses import dataclass

import numpy as np

from tacauchy_rig.core.arrays import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class TipDistance:
    """Signed distance to a tip in the (r, z) half-plane, positive outside."""

    value: FloatArray  # distance [m], shape [point_count]
    gradient: FloatArray  # unit outward normal, shape [point_count, 2]
    hessian: FloatArray  # second derivative [1/m], shape [point_count, 2, 2]


@dataclass(frozen=True, slots=True, kw_only=True)
class Tip:
    """A cylinder with a rounded edge; a ball is one that is all edge, up to its equator."""

    diameter_m: float

    @property
    def rim_radius_m(self) -> float:
        """Radius of the cylinder [m]."""
        return 0.5 * self.diameter_m

    @property
    def edge_radius_m(self) -> float:
        """Radius of the rounded edge [m]."""
        return self.rim_radius_m

    def height(self, radius: FloatArray) -> FloatArray:
        """Return the underside's height above the tip [m], inf beside the body."""
        edge_m = self.edge_radius_m
        inside = np.clip(radius - (self.rim_radius_m - edge_m), 0.0, edge_m)
        height = edge_m - np.sqrt(edge_m**2 - inside**2)
        return np.where(radius <= self.rim_radius_m, height, np.inf)

    def distance(self, radius: FloatArray, z: FloatArray) -> TipDistance:
        """Return the signed distance of points (r, z) [m] from the body."""
        toward_wall = radius - (self.rim_radius_m - self.edge_radius_m)
        toward_face = self.edge_radius_m - z
        corner = np.stack([np.maximum(toward_wall, 0.0), np.maximum(toward_face, 0.0)], axis=-1)
        length = np.linalg.norm(corner, axis=-1)
        core = length == 0.0
        safe = np.where(core, 1.0, length)
        normal = corner / safe[:, None] * np.array([1.0, -1.0])
        face_nearer = toward_face >= toward_wall
        normal[core] = np.where(face_nearer[core, None], [0.0, -1.0], [1.0, 0.0])
        value = np.where(core, np.maximum(toward_wall, toward_face), length) - self.edge_radius_m
        curvature = np.where((toward_wall > 0.0) & (toward_face > 0.0), 1.0 / safe, 0.0)
        tangent = np.stack([normal[:, 1], -normal[:, 0]], axis=-1)
        hessian = curvature[:, None, None] * tangent[:, :, None] * tangent[:, None, :]
        return TipDistance(value=value, gradient=normal, hessian=hessian)


@dataclass(frozen=True, slots=True, kw_only=True)
class CylinderTip(Tip):
    """Flat punch with a rounded edge."""

    fillet_m: float = 1e-4

    @property
    def edge_radius_m(self) -> float:
        """Radius of the rounded edge [m]."""
        return self.fillet_m


class SphereTip(Tip):
    """Ball."""
