"""Markers on a gel: points that the simulated surface carries, seen, and printed over images."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from sim.device import Device
from sim.fields.saved_press import SurfaceState, TopSurface
from sim.mesh.elements import linear_facets
from sim.optics.markers import marker_kernel as kernels
from sim.optics.markers.marker_tracking import FINE, PrintedMarkers
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.sensor import MarkerGrid
from tacauchy_rig.core.arrays import FloatArray, ImageArray, IndexArray, IntArray
from tacauchy_rig.core.errors import ConfigError

_SPACING_PX = 4  # of the lattice of points whose motion is interpolated between
_NEAREST = 24  # facets that are tried first for a point
_TOLERANCE = 1e-6
_EDGE_PX = 1.0
_INK = 0.15


class SeenPoints:
    """Points of a gel's surface as a camera sees them, in many environments on one device.

    Args:
        points: x, y at rest [m], shape [n, 2].
        count: Environments.
        beside: Points beside the surface move with its border; otherwise they are refused.
    """

    def __init__(
        self,
        top: TopSurface,
        points: FloatArray,
        geometry: CameraGeometry,
        *,
        count: int = 1,
        device: str = "cpu",
        beside: bool = False,
    ) -> None:
        self._device = on = Device(device)
        facets = linear_facets(top.faces)
        chosen, weights = _cover(top.rest[facets][..., :2], points, beside=beside)
        corners = facets[chosen]
        tables = {"nodes": top.sources[corners], "signs": top.signs[corners]}
        tables |= {"rest": top.rest[corners], "rest_px": geometry.to_pixels(points)}
        tables["weights"] = weights
        self._points = on.tables(
            kernels.Points,
            tables,
            back=wp.mat22d(*np.linalg.inv(geometry.direction_matrix).reshape(-1)),
            middle=wp.vec2d(0.5 * (geometry.width - 1), 0.5 * (geometry.height - 1)),
            per_distance=1.0 / geometry.distance_m,
        )
        self._seen: Any = on.zeros((count, len(points), 2), wp.float32)

    def pixels(self, positions: Any) -> Any:
        """Return columns and rows [px], Warp float32, shape [count, n, 2].

        Positions of a model's nodes [m] are vec3d, of shape [count, node_count], on the device.
        """
        inputs = [self._points, positions]
        self._device.launch(kernels.see_points, self._seen.shape[:2], inputs, [self._seen])
        return self._seen


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


def surface_displacement(surface: SurfaceState, points: FloatArray) -> FloatArray:
    """Interpolate the displacement [m] of points given by x, y at rest [m], shape [n, 3] of [n, 2].

    Raises:
        ConfigError: A point lies beside the surface.
    """
    facets = linear_facets(surface.faces)
    chosen, weights = _cover(surface.positions_rest[facets][..., :2], points, beside=False)
    moved = (surface.positions - surface.positions_rest)[facets[chosen]]
    return np.asarray(np.einsum("nc,nci->ni", weights, moved))


def seen_motion(surface: SurfaceState, places: FloatArray, geometry: CameraGeometry) -> FloatArray:
    """Return by how much points, x and y at rest [m], move in the image [px], both [n, 2].

    Raises:
        ConfigError: A point lies beside the surface.
    """
    points = SeenPoints(surface.top, places, geometry)
    positions = Device("cpu").array(surface.positions[None], wp.vec3d)
    return np.asarray(points.pixels(positions).numpy()[0] - geometry.to_pixels(places))


class MarkerPrinter:
    """Prints the markers of a no-contact frame over ``count`` images of bare gel, on one device."""

    def __init__(
        self,
        top: TopSurface,
        markers: PrintedMarkers,
        geometry: CameraGeometry,
        *,
        count: int = 1,
        device: str = "cpu",
    ) -> None:
        self._device = on = Device(device)
        self._size = (-(-geometry.height // _SPACING_PX) + 1, -(-geometry.width // _SPACING_PX) + 1)
        rows, columns = np.indices(self._size).reshape(2, -1) * float(_SPACING_PX)
        at = geometry.to_pad(np.stack([columns, rows], axis=1))
        self._lattice = SeenPoints(top, at, geometry, count=count, device=device, beside=True)
        shape = (count, *self._size)
        self._moved, self._motion = (on.zeros(shape, wp.vec2f) for _ in range(2))
        self._ink: Any = on.array(markers.fine, wp.vec4f)
        pixels = _any_of((markers.fine != (1.0, 0.0, 0.0, 0.0)).any(axis=2), FINE)
        self._inked, self._touched = (
            on.array(ndimage.binary_dilation(each, np.ones((3, 3))), wp.uint8)
            for each in (_any_of(pixels, _SPACING_PX), pixels)
        )
        self._dark = wp.vec3f(*markers.dark.tolist())

    def over(self, images: Any, positions: Any) -> None:
        """Print over images of the bare gel, Warp uint8, shape [count, height, width, 3].

        Positions are a model's nodes [m], vec3d, of shape [count, node_count].
        """
        launch, spacing = self._device.launch, float(_SPACING_PX)
        seen = self._lattice.pixels(positions)
        launch(kernels.motion_of, self._moved.shape, [spacing, seen], [self._moved])
        launch(kernels.came_from, self._moved.shape, [spacing, self._moved], [self._motion])
        cells = (len(images), self._size[0] - 1, self._size[1] - 1)
        printed = [self._dark, self._ink, self._inked, self._touched]
        taken = [_SPACING_PX, float(FINE), *printed, self._motion]
        launch(kernels.print_ink, cells, taken, [images])

    def image_over(self, image: ImageArray, surface: SurfaceState) -> ImageArray:
        """Return one image, RGB, of a processor's printer, with markers over it."""
        # Warp would convert byte by byte what it copies.
        printed: Any = wp.array(image[None].copy(), dtype=wp.uint8, device="cpu", copy=False)
        self.over(printed, self._device.array(surface.positions[None], wp.vec3d))
        return np.asarray(printed.numpy()[0])


def _any_of(marked: NDArray[np.bool_], size: int) -> NDArray[np.bool_]:
    """Return in which squares of some size there is a mark; those at the ends may be cut."""
    rows = np.maximum.reduceat(marked, range(0, len(marked), size), axis=0)
    return np.asarray(np.maximum.reduceat(rows, range(0, marked.shape[1], size), axis=1))


def marker_places(grid: MarkerGrid) -> FloatArray:
    """Return the markers' centres at rest from the pad's centre [m], row by row, shape [n, 2]."""
    x = (np.arange(grid.columns) - 0.5 * (grid.columns - 1)) * grid.pitch_m[0]
    y = (np.arange(grid.rows) - 0.5 * (grid.rows - 1)) * grid.pitch_m[1]
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def draw_markers(
    image: ImageArray, places: FloatArray, radius_m: float, geometry: CameraGeometry
) -> ImageArray:
    """Print dots at places on the pad [m], [n, 2], over RGB, uint8, soft-edged over one pixel."""
    away = cKDTree(places).query(np.stack(geometry.pad_grid(), axis=-1))[0]
    inside = (radius_m - away) / geometry.mean_scale_m
    cover = np.clip(inside / _EDGE_PX + 0.5, 0.0, 1.0)
    dimmed = image * (1.0 - (1.0 - _INK) * cover[..., None])
    return np.asarray(np.rint(dimmed), dtype=np.uint8)
