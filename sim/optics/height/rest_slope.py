"""Slope of an unloaded pad's top: a dome's colours are in the no-contact frame already."""

from __future__ import annotations

import numpy as np

from sim.scene.pad import Pad
from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig.core.arrays import FloatArray

_STEP_M = 5e-5
_TOUCHING_ROUNDS = 4


def pad_slopes(pad: Pad, places_m: FloatArray) -> FloatArray:
    """Return dz/dx and dz/dy of the top at rest at x, y [m], [..., 2], zero beside the pad."""
    x, y, step = places_m[..., 0], places_m[..., 1], _STEP_M
    with np.errstate(invalid="ignore"):
        along = pad.height_at(x + step, y) - pad.height_at(x - step, y)
        across = pad.height_at(x, y + step) - pad.height_at(x, y - step)
    slopes = np.stack([along, across], axis=-1) / (2.0 * step)
    return np.where(np.isfinite(slopes), slopes, 0.0)


def rest_slopes(pad: Pad, geometry: CameraGeometry) -> FloatArray:
    """Return a pad's slope along columns and rows at every pixel, shape [2, height, width]."""
    slopes = pad_slopes(pad, np.stack(geometry.pad_grid(), axis=-1))
    directions = geometry.direction_matrix
    along = slopes @ (directions / np.linalg.norm(directions, axis=0))
    return np.ascontiguousarray(np.moveaxis(along, -1, 0))


def touching_places(axes_m: FloatArray, pad: Pad, *, ball_radius_m: float) -> FloatArray:
    """Return where balls with these axes touch a pad, x and y from its centre [m], shape [n, 2].

    Ball and gel have one slope there: on a dome that is beside the axis, towards the top.
    """
    places = axes_m
    for _ in range(_TOUCHING_ROUNDS):
        places = axes_m + ball_radius_m * pad_slopes(pad, places)
    return places
