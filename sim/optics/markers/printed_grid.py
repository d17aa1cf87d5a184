"""Printed markers in a tactile image: where they start, where they go, what they look like."""

from __future__ import annotations

import numpy as np

from sim.arrays import FloatArray
from sim.optics.camera_geometry import CameraGeometry, ImageArray
from sim.sensor.sensor import MarkerGrid

_EDGE_PX = 1.0
_INK = 0.15


def marker_places(grid: MarkerGrid) -> FloatArray:
    """Return the markers' centres at rest from the pad's centre [m], row by row, shape [n, 2]."""
    x = (np.arange(grid.columns) - 0.5 * (grid.columns - 1)) * grid.pitch_m[0]
    y = (np.arange(grid.rows) - 0.5 * (grid.rows - 1)) * grid.pitch_m[1]
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def draw_markers(
    image: ImageArray, places: FloatArray, radius_m: float, geometry: CameraGeometry
) -> ImageArray:
    """Print dots over an image.

    Args:
        image: RGB, uint8, shape [height, width, 3].
        places: Centres of the dots on the pad [m], shape [n, 2].
        radius_m: Radius of the dots [m].
        geometry: Pixels.

    Returns:
        Image of the same shape, with edges softened over one pixel.
    """
    cover = np.zeros(image.shape[:2])
    reach = radius_m / min(geometry.scale_x_m, geometry.scale_y_m) + 2.0 * _EDGE_PX
    for pixel, place in zip(geometry.to_pixels(places), places, strict=True):
        low = np.maximum(np.ceil(pixel - reach), 0).astype(int)
        high = np.minimum(np.floor(pixel + reach), (geometry.width - 1, geometry.height - 1))
        rows, columns = np.mgrid[low[1] : int(high[1]) + 1, low[0] : int(high[0]) + 1]
        if rows.size == 0:
            continue
        offset = geometry.to_pad(np.stack([columns, rows], axis=-1)) - place
        inside = (radius_m - np.hypot(offset[..., 0], offset[..., 1])) / geometry.mean_scale_m
        window = cover[rows[0, 0] : rows[-1, 0] + 1, columns[0, 0] : columns[0, -1] + 1]
        np.maximum(window, np.clip(inside / _EDGE_PX + 0.5, 0.0, 1.0), out=window)
    dimmed = image * (1.0 - (1.0 - _INK) * cover[..., None])
    return np.asarray(np.rint(dimmed), dtype=np.uint8)
