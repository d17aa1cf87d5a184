"""Printed dots on the gel, moved with the surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.emulators.plant.arrays import FloatArray, SingleArray
from drivers.emulators.plant.gel import SurfaceProfile
from drivers.emulators.plant.view import View

_REFLECTANCE = 0.12
_EDGE_M = 4e-5


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerGrid:
    """A rectangular grid of dots, centred on the gel."""

    columns: int = 9
    rows: int = 7
    pitch_m: tuple[float, float] = (2.41e-3, 2.46e-3)
    radius_m: float = 0.35e-3

    def rest(self) -> FloatArray:
        """Return the centres at rest [m], shape [rows * columns, 2]."""
        x = (np.arange(self.columns) - 0.5 * (self.columns - 1)) * self.pitch_m[0]
        y = (np.arange(self.rows) - 0.5 * (self.rows - 1)) * self.pitch_m[1]
        return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)

    def moved(self, profile: SurfaceProfile | None) -> FloatArray:
        """Return the centres on the pressed surface [m], shape [rows * columns, 2]."""
        rest = self.rest()
        if profile is None or profile.depth_m <= 0.0:
            return rest
        arm = rest - np.asarray(profile.centre)
        radius = np.maximum(np.linalg.norm(arm, axis=-1, keepdims=True), 1e-12)
        shift = np.interp(radius, profile.radius_rest, profile.radius - profile.radius_rest)
        moved: FloatArray = rest + arm / radius * shift
        return moved


def marker_reflectance(grid: MarkerGrid, profile: SurfaceProfile | None, view: View) -> SingleArray:
    """Return what the dots leave of the paint's reflectance, shape [height, width]."""
    reflectance = np.ones((view.height, view.width), np.float32)
    x, y = view.gel_points()
    for centre_x, centre_y in grid.moved(profile):
        column, row = view.pixel(float(centre_x), float(centre_y))
        reach = (grid.radius_m + 3 * _EDGE_M) / min(view.m_per_px)
        rows = slice(max(0, int(row - reach)), max(0, int(row + reach) + 2))
        columns = slice(max(0, int(column - reach)), max(0, int(column + reach) + 2))
        distance = np.hypot(x[rows, columns] - centre_x, y[rows, columns] - centre_y)
        cover = np.clip((grid.radius_m - distance) / _EDGE_M + 0.5, 0.0, 1.0)
        reflectance[rows, columns] *= 1.0 - (1.0 - _REFLECTANCE) * cover
    return reflectance
