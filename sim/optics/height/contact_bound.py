"""The indenter as a ceiling over the gel: height and slope of its underside."""

from __future__ import annotations

import numpy as np

from sim.arrays import FloatArray
from sim.fields.surface import SurfaceState

_TILT_ITERATIONS = 40
_SLOPE_STEP_M = 1e-6


def indenter_height(surface: SurfaceState, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the height of the indenter's underside over pad points.

    A tilted indenter is solved for by fixed-point iteration along z, which contracts while tilt
    times slope stays below one; the flanks of a tilted cylinder do not count as underside.

    Args:
        surface: Indenter and pose.
        x: Pad x [m], any shape.
        y: Pad y [m], same shape.

    Returns:
        Heights in the pad's frame [m], same shape; inf beside the indenter.
    """
    rotation = np.asarray(surface.indenter_rotation, dtype=np.float64)
    dx = x - surface.indenter_position[0]
    dy = y - surface.indenter_position[1]
    height = np.zeros_like(dx)
    lateral = rotation[0, 2] * dx + rotation[1, 2] * dy
    upright = np.allclose(rotation[:, 2], (0.0, 0.0, 1.0), atol=1e-12)
    for _ in range(1 if upright else _TILT_ITERATIONS):
        at_x = rotation[0, 0] * dx + rotation[1, 0] * dy + rotation[2, 0] * height
        at_y = rotation[0, 1] * dx + rotation[1, 1] * dy + rotation[2, 1] * height
        underside = surface.indenter.lower_surface(at_x, at_y)
        beside = ~np.isfinite(underside)
        new_height = (np.where(beside, 0.0, underside) - lateral) / rotation[2, 2]
        settled = bool(np.all(np.abs(new_height - height) < 1e-12))
        height = new_height
        if settled:
            break
    return np.where(beside, np.inf, height + surface.indenter_position[2])


def indenter_slope(surface: SurfaceState, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return dz/dx and dz/dy of the indenter's underside, shape [..., 2]; not finite beside it."""
    step = _SLOPE_STEP_M
    with np.errstate(invalid="ignore"):
        along_x = indenter_height(surface, x + step, y) - indenter_height(surface, x - step, y)
        along_y = indenter_height(surface, x, y + step) - indenter_height(surface, x, y - step)
    return np.stack([along_x, along_y], axis=-1) / (2.0 * step)
