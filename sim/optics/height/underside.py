"""Height of an indenter's underside over the pad: the ceiling of a height map.

Kernels are compiled for analytic bodies and, when the first mesh is pressed, for those.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from sim.contact.indenter_distance import AnyBody, Body, MeshBody, Poses, body_of, posed, poses_at
from sim.device import Device
from sim.fields.surface import SurfaceState
from sim.scene.triangle_rays import BESIDE, lowest_height
from tacauchy_rig.core.arrays import FloatArray

_TILT_ITERATIONS = wp.constant(40)
_SETTLED_M = wp.constant(wp.float64(1.0e-12))


@wp.func
def _lowest(body: Body, x: wp.float64, y: wp.float64):
    """Return the height over a point in the indenter's frame, ``BESIDE`` beside the body."""
    zero = wp.float64(0.0)
    away = x * x + y * y
    radius = wp.sqrt(away)
    inside = wp.clamp(radius - (body.radius - body.fillet), zero, body.fillet)
    squared = wp.where(body.is_ball, away, inside * inside)  # the root costs a ball digits
    arc = wp.sqrt(wp.max(body.fillet * body.fillet - squared, zero))
    return wp.where(radius > body.radius, BESIDE, body.fillet - arc)


@wp.func  # type: ignore[no-redef]
def _lowest(body: MeshBody, x: wp.float64, y: wp.float64):
    """Return the height over a point in the indenter's frame, ``BESIDE`` beside the body."""
    return lowest_height(body.surface, x, y)


@wp.func  # type: ignore[no-redef]
def _lowest(body: AnyBody, x: wp.float64, y: wp.float64):
    """Return the height over a point in the indenter's frame, ``BESIDE`` beside the body."""
    lowest = wp.float64(0.0)
    if body.is_mesh:
        lowest = lowest_height(body.mesh.surface, x, y)
        if lowest < BESIDE:
            lowest -= body.rounding
    else:
        lowest = _lowest(body.analytic, x, y)
    return lowest


@wp.func
def underside(body: Any, poses: Poses, away_m: wp.float64, env: int, x: wp.float64, y: wp.float64):
    """Return the height of an environment's indenter over the pad [m], ``BESIDE`` beside it.

    The body is larger than the indenter by ``away_m``, and its tip lies lower by as much.

    A tilted indenter is solved for by fixed-point iteration along z, which contracts while tilt
    times slope stays below one; the flanks of a tilted cylinder do not count as underside.
    """
    here = posed(body, poses, env)
    R = poses.rotations[env]
    tip = poses.tips[env]
    dx = x - (tip[0] - away_m * R[0, 2])
    dy = y - (tip[1] - away_m * R[1, 2])
    lateral = R[0, 2] * dx + R[1, 2] * dy
    upright = wp.abs(R[0, 2]) + wp.abs(R[1, 2]) < _SETTLED_M
    height = wp.float64(0.0)
    beside = bool(False)  # noqa: UP018 - a variable to Warp, not a constant
    for _ in range(_TILT_ITERATIONS):
        at_x = R[0, 0] * dx + R[1, 0] * dy + R[2, 0] * height
        at_y = R[0, 1] * dx + R[1, 1] * dy + R[2, 1] * height
        lowest = _lowest(here, at_x, at_y)
        beside = lowest >= BESIDE
        found = (wp.where(beside, wp.float64(0.0), lowest) - lateral) / R[2, 2]
        settled = wp.abs(found - height) < _SETTLED_M
        height = found
        if upright or settled:
            break
    return wp.where(beside, BESIDE, height + tip[2] - away_m * R[2, 2])


@wp.kernel(enable_backward=False)
def _undersides(
    body: Any,
    poses: Poses,
    # Data in:
    places: wp.array(dtype=wp.vec2d),
    # Data out:
    height_out: wp.array(dtype=wp.float64),
):
    """Find the underside over places."""
    i = wp.tid()
    height_out[i] = underside(body, poses, wp.float64(0.0), 0, places[i][0], places[i][1])


def indenter_height(surface: SurfaceState, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the height of the indenter's underside over x, y of the pad [m], inf beside it."""
    device = Device("cpu")
    poses = poses_at(surface.indenter_position[None], surface.indenter_rotation[None], device)
    places = device.array(np.stack([x, y], axis=-1).reshape(-1, 2), wp.vec2d)
    height = device.empty((len(places),), wp.float64)
    body = body_of(surface.indenter)
    device.launch(_undersides, (len(places),), [body, poses, places], [height])
    found: FloatArray = height.numpy().reshape(np.shape(x))
    return np.where(found >= float(BESIDE), np.inf, found)
