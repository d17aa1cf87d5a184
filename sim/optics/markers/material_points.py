"""Where points printed on the gel's surface go: carried by the simulated surface."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from sim.device import Device
from sim.fields.surface import SurfaceState, TopSurface
from sim.mesh.elements import linear_facets
from sim.optics.markers.point_kernel import carry_points
from tacauchy_rig.core.arrays import FloatArray, IntArray
from tacauchy_rig.core.errors import ConfigError

_TOLERANCE = 1e-6


class MaterialPoints:
    """Points of a gel's surface, on one device, in as many environments as there are positions.

    Args:
        points: x, y at rest [m], shape [n, 2].

    Raises:
        ConfigError: A point lies beside the surface.
    """

    def __init__(
        self, top: TopSurface, points: FloatArray, *, count: int = 1, device: str = "cpu"
    ) -> None:
        self._device = Device(device)
        facets = linear_facets(top.faces)
        chosen, weights = _cover(top.rest[facets][..., :2], points)
        corners, array = facets[chosen], self._device.array
        self._tables = [
            array(top.sources[corners], wp.int32),
            array(top.signs[corners], wp.vec3d),
            array(top.rest[corners], wp.vec3d),
            array(weights, wp.vec3d),
        ]
        self._moved: Any = self._device.zeros((count, len(points)), wp.vec3d)

    def displacement(self, positions: Any) -> Any:
        """Return the points' displacement [m], vec3d, shape [count, n]; zero where nothing moved.

        Args:
            positions: A model's nodes [m], vec3d, shape [count, node_count], on the device.
        """
        taken = [*self._tables, positions]
        self._device.launch(carry_points, self._moved.shape, taken, [self._moved])
        return self._moved


def surface_displacement(surface: SurfaceState, points: FloatArray) -> FloatArray:
    """Interpolate the displacement [m] of points given by x, y at rest [m], shape [n, 3] of [n, 2].

    Raises:
        ConfigError: A point lies beside the surface.
    """
    positions = Device("cpu").array(surface.positions[None], wp.vec3d)
    found = MaterialPoints(surface.top, points).displacement(positions)
    return np.asarray(found.numpy()[0])


def _cover(corners: FloatArray, points: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return a facet for each point, and its coordinates in it; on an edge either is right."""
    origin = corners[:, 2]
    u, v = corners[:, 0] - origin, corners[:, 1] - origin
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    safe = np.where(area == 0.0, np.inf, area)
    offset = points[:, None] - origin
    first = (offset[..., 0] * v[:, 1] - offset[..., 1] * v[:, 0]) / safe
    second = (u[:, 0] * offset[..., 1] - u[:, 1] * offset[..., 0]) / safe
    weights = np.stack([first, second, 1.0 - first - second], axis=-1)
    inside = np.where(area == 0.0, -np.inf, weights.min(axis=-1))
    facets, number = np.argmax(inside, axis=1), np.arange(len(points))
    for x, y in points[inside[number, facets] < -_TOLERANCE] * 1e3:
        raise ConfigError(
            f"marker at {x:.2f}, {y:.2f} mm lies beside the gel's surface",
            remedy="give fewer markers or a smaller pitch in the sensor's file",
        )
    return facets.astype(np.int32), weights[number, facets]
