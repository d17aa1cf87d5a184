"""Where points printed on the gel's surface go: carried by the simulated surface."""

from __future__ import annotations

import numpy as np

from sim.arrays import FloatArray
from sim.fields.surface import SurfaceState
from sim.optics.height.rasterise import PixelCover
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
    cover = _cover(surface.positions_rest[surface.triangles][..., :2], points)
    moved = surface.positions - surface.positions_rest
    at_corners = moved[surface.triangles[cover.facet]]
    found = np.einsum("nc,ncd->nd", cover.barycentric, at_corners)
    displacement = np.empty((len(points), 3))
    displacement[cover.pixel] = found
    return displacement


def _cover(corners: FloatArray, points: FloatArray) -> PixelCover:
    """Find one facet for each point; a point on an edge takes either."""
    facets = np.empty(len(points), dtype=np.int64)
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
    return PixelCover(pixel=np.arange(len(points)), facet=facets, barycentric=weights)
