"""Markers printed over images of bare gel, where the deformed surface carries them."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import warp as wp

from sim.device import Device, filled
from sim.fields.surface import SurfaceState, TopSurface
from sim.optics.markers.material_points import MaterialPoints
from sim.optics.markers.point_kernel import (
    Projection,
    came_from,
    motion_of,
    print_ink,
    see_points,
)
from sim.optics.markers.printed_markers import PrintedMarkers
from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig.core.arrays import Float32Array, FloatArray, ImageArray

_SPACING_PX = 4  # of the lattice of points whose motion is interpolated between


class SeenPoints:
    """Points of a gel's surface as a camera sees them, in environments on one device.

    Args:
        places: x, y at rest [m], shape [n, 2].
        further: See ``MaterialPoints``.

    Raises:
        ConfigError: A point lies beside the surface.
    """

    def __init__(
        self, top: TopSurface, places: FloatArray, geometry: CameraGeometry, **further: Any
    ) -> None:
        self._points = MaterialPoints(top, places, **further)
        self._device = device = Device(further.get("device", "cpu"))
        self._rest_px: Any = device.array(geometry.to_pixels(places), wp.vec2d)
        self._view = filled(
            Projection,
            back=wp.mat22d(*np.linalg.inv(geometry.direction_matrix).reshape(-1)),
            middle=wp.vec2d(0.5 * (geometry.width - 1), 0.5 * (geometry.height - 1)),
            per_distance=1.0 / geometry.distance_m,
        )
        count = further.get("count", 1)
        self._seen: Any = device.zeros((count, len(places), 2), wp.float32)

    def pixels(self, positions: Any) -> Any:
        """Return columns and rows [px], Warp float32, shape [count, n, 2].

        Args:
            positions: A model's nodes [m], vec3d, shape [count, node_count], on the device.
        """
        moved = self._points.displacement(positions)
        self._device.launch(
            see_points, moved.shape, [self._view, self._rest_px, moved], [self._seen]
        )
        return self._seen


def seen_motion(surface: SurfaceState, places: FloatArray, geometry: CameraGeometry) -> FloatArray:
    """Return by how much points, x and y at rest [m], move in the image [px], both [n, 2].

    Raises:
        ConfigError: A point lies beside the surface.
    """
    points = SeenPoints(surface.top, places, geometry)
    positions = Device("cpu").array(surface.positions[None], wp.vec3d)
    return np.asarray(points.pixels(positions).numpy()[0] - geometry.to_pixels(places))


class MarkerPrinter:
    """Prints the markers of a no-contact frame over images of bare gel, on one device.

    Every pixel finds the gel that it sees, so that markers are deformed like the surface.

    Args:
        top: The gel's surface at rest.
        markers: Of the frame that the images are over.
        count: Images at a time.
    """

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
        pixels = np.stack([columns, rows], axis=1)
        self._lattice = SeenPoints(
            top, geometry.to_pad(pixels), geometry, count=count, device=device, beside=True
        )
        shape = (count, *self._size)
        self._moved: Any = on.zeros(shape, wp.vec2f)
        self._motion: Any = on.zeros(shape, wp.vec2f)
        self._ink: Any = on.array(markers.print, wp.vec4f)
        self._inked: Any = on.array(_inked(markers.print, self._size), wp.uint8)
        self._dark = wp.vec3f(*markers.dark.tolist())

    def over(self, images: Any, positions: Any) -> None:
        """Print over images, Warp uint8, shape [count, height, width, 3].

        Args:
            images: Of the bare gel; they are changed.
            positions: A model's nodes [m], vec3d, shape [count, node_count].
        """
        launch, spacing = self._device.launch, float(_SPACING_PX)
        seen = self._lattice.pixels(positions)
        launch(motion_of, self._moved.shape, [spacing, seen], [self._moved])
        launch(came_from, self._moved.shape, [spacing, self._moved], [self._motion])
        cells = (len(images), self._size[0] - 1, self._size[1] - 1)
        taken = [_SPACING_PX, self._dark, self._ink, self._inked, self._motion]
        launch(print_ink, cells, taken, [images])

    def image_over(self, image: ImageArray, surface: SurfaceState) -> ImageArray:
        """Return one image, RGB, of a processor's printer, with markers over it."""
        printed: Any = self._device.array(image[None], wp.uint8)
        self.over(printed, self._device.array(surface.positions[None], wp.vec3d))
        return np.asarray(printed.numpy()[0])


def _inked(printed: Float32Array, lattice: tuple[int, int]) -> ImageArray:
    """Return 1 for cells of a lattice that have ink or a neighbour with ink, shape [rows, columns].

    Args:
        printed: See ``PrintedMarkers``, shape [height, width, 4].
        lattice: Rows and columns of its points.
    """
    rows, columns = lattice[0] - 1, lattice[1] - 1
    changed = (printed != (1.0, 0.0, 0.0, 0.0)).any(axis=2)
    short = [
        (0, _SPACING_PX * n - size) for n, size in zip((rows, columns), changed.shape, strict=True)
    ]
    cells = np.pad(changed, short).reshape(rows, _SPACING_PX, columns, _SPACING_PX).any(axis=(1, 3))
    return np.asarray(
        cv2.dilate(np.asarray(cells, dtype=np.uint8), np.ones((3, 3), np.uint8)), dtype=np.uint8
    )
