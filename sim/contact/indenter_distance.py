"""Signed distance to the rigid indenter on the device, in double precision."""

from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

from sim.device import Device, filled
from sim.scene.indenter import Indenter, IndenterSet, MeshIndenter, Sphere
from sim.scene.triangle_distance import DeviceSurface, nearby_distance, on_device
from tacauchy_rig.core.arrays import FloatArray

# Of a body's least extent: how far its triangles are moved inwards at most, to round its edges.
_INSET_SHARE = 0.1
# Radius of a plate [m], which ends nowhere on a pad.
_PLATE_M = 1e9


@wp.struct
class Body:
    """An indenter at its pose; local = rotation^T (x - position).

    It is made of triangles, or a cylinder with a fillet, as wide as a plate or a ball's lower half;
    ``is_ball`` says whether it has the upper one.
    """

    is_mesh: wp.bool
    is_ball: wp.bool
    radius: wp.float64
    fillet: wp.float64
    surface: DeviceSurface
    position: wp.vec3d
    rotation: wp.mat33d


@wp.struct
class Poses:
    """The indenter's pose in every environment, shape [environment_count] each."""

    tips: wp.array(dtype=wp.vec3d)  # in the pad's frame [m]
    rotations: wp.array(dtype=wp.mat33d)  # indenter frame to pad frame


@wp.func
def posed(bodies: wp.array(dtype=Body), poses: Poses, b: wp.int32) -> Body:
    """Return the indenter of an environment at its pose."""
    body = bodies[b % bodies.shape[0]]
    body.position = poses.tips[b]
    body.rotation = poses.rotations[b]
    return body


@lru_cache(maxsize=8)
def body_of(indenter: Indenter | IndenterSet, *, device: str = "cpu") -> Any:
    """Return a ``Body`` of each environment on a device, or of all, without a pose; made once."""
    every = indenter
    if not isinstance(every, IndenterSet):
        every = IndenterSet(bodies=(every,), which=(0,))
    kept = [_described(body, every.rounding_m, device) for body in every.bodies]
    memory = b"".join(bytes(body.__ctype__()) for body, _ in kept)
    rows = np.frombuffer(memory, dtype=Body.numpy_dtype())[list(every.which)]
    bodies: Any = wp.array(rows, dtype=Body, device=device)
    bodies.kept = kept  # it holds the places of their arrays and trees, which must live as long
    return bodies


def _described(indenter: Indenter, rounding_m: float, device: str) -> tuple[Any, Any]:
    """Return a ``Body`` with round edges, and the tree that it needs."""
    if isinstance(indenter, MeshIndenter):
        most_m = _INSET_SHARE * float(indenter.size_m.min())
        rounded = indenter.with_edges(min(rounding_m, most_m))
        surface, tree = on_device(rounded.surface, device, rounding_m=rounded.rounding_m)
        return filled(Body, is_mesh=True, surface=surface), tree
    radius_m = getattr(indenter, "radius_m", _PLATE_M)
    fillet_m = max(getattr(indenter, "fillet_m", 0.0), min(rounding_m, radius_m))
    is_ball = isinstance(indenter, Sphere)
    return filled(Body, is_ball=is_ball, radius=radius_m, fillet=fillet_m), None


def poses_at(tips: FloatArray, rotations: FloatArray, device: Device) -> Any:
    """Upload poses.

    Args:
        tips: In the pad's frame [m], shape [environment_count, 3].
        rotations: Indenter frame to pad frame, shape [environment_count, 3, 3].
    """
    return device.tables(Poses, {"tips": tips, "rotations": rotations})


@wp.func
def local_point(body: Body, x: wp.vec3d) -> wp.vec3d:
    """Return a point of the pad's frame in the indenter's frame [m]."""
    return wp.transpose(body.rotation) * (x - body.position)


@wp.func
def _analytic_distance(body: Body, p: wp.vec3d):
    """Return the gap [m] of a point in the indenter's frame, and its gradient there."""
    zero = wp.float64(0.0)
    gap = -p[2]
    n = wp.vec3d(zero, zero, wp.float64(-1.0))
    if body.is_ball:
        c = p - wp.vec3d(zero, zero, body.radius)
        length = wp.max(wp.length(c), wp.float64(1.0e-30))
        gap = length - body.radius
        n = c / length
    else:
        r = wp.max(wp.sqrt(p[0] * p[0] + p[1] * p[1]), wp.float64(1.0e-30))
        side = r - (body.radius - body.fillet)
        below = body.fillet - p[2]
        outward = wp.vec3d(p[0] / r, p[1] / r, zero)
        if side > zero and below > zero:
            corner = wp.sqrt(side * side + below * below)
            gap = corner - body.fillet
            n = (outward * side + n * below) / corner
        elif below >= side:
            gap = below - body.fillet
        else:
            gap = side - body.fillet
            n = outward
    return gap, n


@wp.func
def nearby_gap(body: Body, x: wp.vec3d, reach: wp.float64):
    """Return the gap [m] and its gradient; beyond a reach [m] triangles may be farther off."""
    p = local_point(body, x)
    gap, n = wp.float64(0.0), wp.vec3d()
    if body.is_mesh:
        gap, n, _face = nearby_distance(body.surface, p, reach, -1)
    else:
        gap, n = _analytic_distance(body, p)
    return gap, body.rotation * n
