"""Height of an indenter's underside where a height map is bounded by it."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from sim.contact.indenter_distance import Poses, body_of, poses_at
from sim.device import Device
from sim.fields.surface import SurfaceState
from sim.optics.height.underside_kernel import underside
from sim.scene.triangle_rays import BESIDE
from tacauchy_rig.core.arrays import FloatArray


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
