"""Fields of a press seen in polar coordinates about the indenter's axis, beside exact ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import matplotlib.tri
import numpy as np

from sim.fields.press_fields import top_surface
from sim.mesh.elements import quadratic_triangle_values
from sim.solve.model import Model
from sim.solve.path_point import PathPoint
from tacauchy_rig.core.arrays import FloatArray

_RADII, _ANGLES = 80, 96


@dataclass(frozen=True, slots=True, kw_only=True)
class RoundField:
    """A field on circles about an axis.

    Attributes:
        radii_m: Shape [radius_count].
        angles_rad: Shape [angle_count].
        values: Shape [radius_count, angle_count, ...].
    """

    radii_m: FloatArray
    angles_rad: FloatArray
    values: FloatArray

    def error_relative(self, exact: FloatArray, *, within_m: float) -> float:
        """Return the L2 norm of the difference over that of the exact field, up to a radius."""
        inside = self.radii_m < within_m
        weight = self.radii_m[inside]

        def size(values: FloatArray) -> float:
            square = values[inside].reshape(len(weight), -1) ** 2
            return float(weight @ square.sum(axis=1))

        off = self.values - exact
        return float(np.sqrt(size(off) / size(self.values - off)))

    @property
    def round(self) -> FloatArray:
        """Mean over every circle, shape [radius_count, ...]."""
        return np.asarray(self.values.mean(axis=1))

    def asymmetry_relative(self, *, within_m: float) -> float:
        """Return the largest deviation from the mean over a circle, over the largest value."""
        inside = self.values[self.radii_m < within_m]
        off = inside - inside.mean(axis=1, keepdims=True)
        return float(np.abs(off).max() / np.abs(inside).max())

    def polar(self) -> RoundField:
        """Return a vector field by its parts away from and around the axis, and upwards."""
        cos, sin = np.cos(self.angles_rad), np.sin(self.angles_rad)
        x, y, z = np.moveaxis(self.values, -1, 0)
        parts = np.stack([x * cos + y * sin, y * cos - x * sin, z], axis=-1)
        return RoundField(radii_m=self.radii_m, angles_rad=self.angles_rad, values=parts)


def on_circles(
    model: Model, point: PathPoint, *, reach_m: float
) -> Callable[[FloatArray], RoundField]:
    """Return what samples a nodal field of the model on circles about the indenter's tip.

    Args:
        reach_m: Radius of the largest circle [m].
    """
    top = top_surface(model)
    places = top.of(point.state.positions)[:, :2] - point.state.tip[:2]
    radii = reach_m * (np.arange(_RADII) + 0.5) / _RADII
    angles = 2.0 * np.pi * (np.arange(_ANGLES) + 0.5) / _ANGLES
    x, y = np.outer(radii, np.cos(angles)), np.outer(radii, np.sin(angles))
    corners = top.faces[:, :3]
    plan = matplotlib.tri.Triangulation(places[:, 0], places[:, 1], corners)
    face = np.asarray(plan.get_trifinder()(x, y)).reshape(-1)
    a, b, c = (places[corners[face, k]] for k in range(3))
    sides = np.stack([b - a, c - a], axis=2)
    along = np.linalg.solve(sides, (np.column_stack([x.ravel(), y.ravel()]) - a)[..., None])[..., 0]
    shares = np.column_stack([1.0 - along.sum(axis=1), along])
    if top.faces.shape[1] == 6:
        shares = quadratic_triangle_values(shares)

    def sampled(nodal: FloatArray) -> RoundField:
        whole = nodal[top.sources]
        if nodal.ndim == 2:
            whole = whole * top.signs
        values: FloatArray = np.einsum("sk,sk...->s...", shares, whole[top.faces[face]])
        shape = (_RADII, _ANGLES, *nodal.shape[1:])
        return RoundField(radii_m=radii, angles_rad=angles, values=values.reshape(shape))

    return sampled
