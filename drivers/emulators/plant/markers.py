"""Printed dots on the gel, moved with its surface, and the light that they leave."""

from __future__ import annotations

import numpy as np

from drivers.emulators.plant.arrays import FloatArray, SingleArray
from drivers.emulators.plant.gel import SurfaceProfile
from drivers.emulators.plant.unit import MarkerGrid
from drivers.emulators.plant.view import View

_REFLECTANCE = 0.12
_EDGE_M = 4e-5


def moved_dots(grid: MarkerGrid, profile: SurfaceProfile | None) -> FloatArray:
    """Return the centres on the pressed surface [m], shape [rows * columns, 2]."""
    rest = grid.rest()
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
    for centre_x, centre_y in moved_dots(grid, profile):
        column, row = view.pixel(float(centre_x), float(centre_y))
        reach = (grid.radius_m + 3 * _EDGE_M) / min(view.m_per_px)
        rows = slice(max(0, int(row - reach)), max(0, int(row + reach) + 2))
        columns = slice(max(0, int(column - reach)), max(0, int(column + reach) + 2))
        distance = np.hypot(x[rows, columns] - centre_x, y[rows, columns] - centre_y)
        cover = np.clip((grid.radius_m - distance) / _EDGE_M + 0.5, 0.0, 1.0)
        reflectance[rows, columns] *= 1.0 - (1.0 - _REFLECTANCE) * cover
    return reflectance
