"""Tilt of a height map by central differences, as a reference for the kernels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig.core.arrays import Float32Array


def surface_tilt(height: NDArray[np.floating], geometry: CameraGeometry) -> Float32Array:
    """Return slope / sqrt(1 + |slope|^2) along image columns and rows.

    Tilt is the sine of the surface's angle and its direction; unlike slope it stays bounded where
    a ball's flank turns vertical. Central differences inside, one-sided at the border.

    Args:
        height: z per pixel [m], shape [height, width].
        geometry: Scale of the pixels.

    Returns:
        Tilt along +column and +row, shape [2, height, width].
    """
    relative = np.asarray(height - height.flat[0], dtype=np.float32)
    tilt = np.empty((2, *relative.shape), dtype=np.float32)
    _central_difference(relative.T, tilt[0].T, geometry.scale_x_m)
    _central_difference(relative, tilt[1], geometry.scale_y_m)
    tilt /= np.sqrt(1.0 + tilt[0] * tilt[0] + tilt[1] * tilt[1])
    return tilt


def _central_difference(values: Float32Array, out: Float32Array, spacing_m: float) -> None:
    if len(values) < 2:
        out[...] = 0.0
        return
    np.subtract(values[2:], values[:-2], out=out[1:-1])
    out[1:-1] *= np.float32(0.5 / spacing_m)
    out[0] = (values[1] - values[0]) / spacing_m
    out[-1] = (values[-1] - values[-2]) / spacing_m
