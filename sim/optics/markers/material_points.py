"""Where points printed on the gel's surface go: carried by the simulated surface."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from scipy.spatial import cKDTree

from sim.device import Device
from sim.fields.surface import SurfaceState, TopSurface
from sim.mesh.elements import linear_facets
from sim.optics.markers.point_kernel import carry_points
from tacauchy_rig.core.arrays import FloatArray, IndexArray, IntArray
from tacauchy_rig.core.errors import ConfigError

_TOLERANCE = 1e-6


class MaterialPoints:
    """Points of a gel's surface, on one device, in as many environments as there are positions.

    Args:
        points: x, y at rest [m], shape [n, 2].
        beside: Points beside the surface move with its border; otherwise they are refused.

    Raises:
        ConfigError: A point lies beside the surface.
    """

    def __init__(
        self,
        top: TopSurface,
        points: FloatArray,
        *,
        count: int = 1,
        device: str = "cpu",
        beside: bool = False,
    ) -> None:
        self._device = Device(device)
        facets = linear_facets(top.faces)
        chosen, weights = _cover(top.rest[facets][..., :2], points, beside=beside)
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


_NEAREST = 24


def _cover(corners: FloatArray, points: FloatArray, *, beside: bool) -> tuple[IntArray, FloatArray]:
    """Return a facet for each point, and its coordinates in it; on an edge either is right.

    The nearest facets are tried first, and all of them for points that none of those holds.
    """
    count = min(_NEAREST, len(corners))
    near = cKDTree(corners.mean(axis=1)).query(points, k=count)[1]
    facets, weights = _best(corners, points, near.reshape(len(points), count))
    out = np.flatnonzero(weights.min(axis=1) < -_TOLERANCE)
    if len(out):
        every = np.broadcast_to(np.arange(len(corners)), (len(out), len(corners)))
        facets[out], weights[out] = _best(corners, points[out], every)
    if not beside:
        for x, y in points[weights.min(axis=1) < -_TOLERANCE] * 1e3:
            raise ConfigError(
                f"marker at {x:.2f}, {y:.2f} mm lies beside the gel's surface",
                remedy="give fewer markers or a smaller pitch in the sensor's file",
            )
    weights = np.maximum(weights, 0.0) if beside else weights
    return facets.astype(np.int32), weights / weights.sum(axis=1, keepdims=True)


def _best(
    corners: FloatArray, points: FloatArray, tried: IndexArray
) -> tuple[IndexArray, FloatArray]:
    """Return which of some facets, [n, m], holds each point best, and its coordinates there."""
    at = corners[tried]
    origin = at[..., 2, :]
    u, v, offset = at[..., 0, :] - origin, at[..., 1, :] - origin, points[:, None] - origin
    area = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
    safe = np.where(area == 0.0, np.inf, area)
    first = (offset[..., 0] * v[..., 1] - offset[..., 1] * v[..., 0]) / safe
    second = (u[..., 0] * offset[..., 1] - u[..., 1] * offset[..., 0]) / safe
    weights = np.stack([first, second, 1.0 - first - second], axis=-1)
    best = np.argmax(np.where(area == 0.0, -np.inf, weights.min(axis=-1)), axis=1)
    number = np.arange(len(points))
    return tried[number, best], weights[number, best]
