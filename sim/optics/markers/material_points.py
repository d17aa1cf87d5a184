"""Where points printed on the gel's surface go: carried by the simulated surface."""

from __future__ import annotations

import numpy as np

from sim.arrays import FloatArray, IntArray
from sim.fields.surface import SurfaceState
from tacauchy_rig.errors import ConfigError

_TOLERANCE = 1e-6


def surface_displacement(surface: SurfaceState, points: FloatArray) -> FloatArray:
    """Interpolate the displacement of the surface at material points.

    Args:
        surface: At rest and deformed.
        points: x, y at rest [m], shape [n, 2].

    Returns:
        Displacement along x, y, z [m], shape [n, 3]; exactly zero where nothing moved.

    Raises:
        ConfigError: A point lies beside the surface.
    """
    facets, weights = _cover(surface.positions_rest[surface.triangles][..., :2], points)
    moved = surface.positions - surface.positions_rest
    return np.asarray(np.einsum("nc,ncd->nd", weights, moved[surface.triangles[facets]]))


def _cover(corners: FloatArray, points: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return a facet for each point, and its coordinates in it; on an edge either is right."""
    facets = np.empty(len(points), dtype=np.int32)
    weights = np.empty((len(points), 3))
    origin = corners[:, 2]
    u, v = corners[:, 0] - origin, corners[:, 1] - origin
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    safe = np.where(area == 0.0, np.inf, area)
    for i, point in enumerate(points):
        offset = point - origin
        first = (offset[:, 0] * v[:, 1] - offset[:, 1] * v[:, 0]) / safe
        second = (u[:, 0] * offset[:, 1] - u[:, 1] * offset[:, 0]) / safe
        third = 1.0 - first - second
        least = np.minimum(np.minimum(first, second), third)
        inside = np.where(area == 0.0, -np.inf, least)
        facet = int(np.argmax(inside))
        if inside[facet] < -_TOLERANCE:
            raise ConfigError(
                f"marker at {point[0] * 1e3:.2f}, {point[1] * 1e3:.2f} mm lies beside the gel's "
                "surface",
                remedy="give fewer markers or a smaller pitch in the sensor's file",
            )
        facets[i] = facet
        weights[i] = first[facet], second[facet], third[facet]
    return facets, weights
