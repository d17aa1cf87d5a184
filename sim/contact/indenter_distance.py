"""Signed distance to the rigid indenter on the device.

Kernels are compiled for analytic bodies and, when the first mesh is pressed, for those: the others
carry nothing of its search.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from sim.contact.triangle_distance import nearby_distance, surface_distance, uploaded_surface
from sim.device import Device, filled
from sim.scene.indenter import Cylinder, Indenter, MeshIndenter, Sphere
from sim.scene.triangle_rays import DeviceSurface
from tacauchy_rig.core.arrays import FloatArray

# Radius of a plate [m], which ends nowhere on a pad.
_PLATE_M = 1e9


@wp.struct
class Body:
    """An analytic indenter at its pose; local = rotation^T (x - position).

    It is a cylinder with a fillet, as wide as a plate or a ball's lower half; ``is_ball`` says
    whether it has the upper one.
    """

    is_ball: wp.bool
    radius: wp.float64
    fillet: wp.float64
    position: wp.vec3d
    rotation: wp.mat33d


@wp.struct
class MeshBody:
    """An indenter made of triangles at its pose."""

    surface: DeviceSurface
    position: wp.vec3d
    rotation: wp.mat33d


@wp.struct
class Poses:
    """The indenter's pose in every environment, shape [environment_count] each.

    Attributes:
        tips: In the pad's frame [m].
        rotations: Indenter frame to pad frame.
    """

    tips: wp.array(dtype=wp.vec3d)
    rotations: wp.array(dtype=wp.mat33d)


@wp.func
def posed(body: Any, poses: Poses, b: wp.int32):
    """Return an indenter at the pose of an environment."""
    made = body
    made.position = poses.tips[b]
    made.rotation = poses.rotations[b]
    return made


def body_kind(indenter: Indenter) -> Any:
    """Return the type of an indenter's description."""
    return MeshBody if isinstance(indenter, MeshIndenter) else Body


def body_of(indenter: Indenter, *, device: str = "cpu") -> Any:
    """Return the device's description of an indenter, without a pose; a mesh is uploaded once."""
    if isinstance(indenter, MeshIndenter):
        return filled(MeshBody, surface=uploaded_surface(indenter, device)[0])
    if isinstance(indenter, Cylinder):
        return filled(Body, radius=indenter.radius_m, fillet=indenter.fillet_m)
    if isinstance(indenter, Sphere):
        return filled(Body, radius=indenter.radius_m, fillet=indenter.radius_m, is_ball=True)
    return filled(Body, radius=_PLATE_M)


def poses_at(tips: FloatArray, rotations: FloatArray, device: Device) -> Any:
    """Upload poses.

    Args:
        tips: In the pad's frame [m], shape [environment_count, 3].
        rotations: Indenter frame to pad frame, shape [environment_count, 3, 3].
    """
    return device.tables(Poses, {"tips": tips, "rotations": rotations})


@wp.func
def local_point(body: Any, x: wp.vec3d) -> wp.vec3d:
    """Return a point of the pad's frame in the indenter's frame [m]."""
    return wp.transpose(body.rotation) * (x - body.position)


@wp.func
def signed_distance(body: Body, x: wp.vec3d):
    """Return the gap [m], positive outside, and its gradient in the pad's frame."""
    zero = wp.float64(0.0)
    p = local_point(body, x)
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
    return gap, body.rotation * n


@wp.func  # type: ignore[no-redef]
def signed_distance(body: MeshBody, x: wp.vec3d):  # noqa: F811 - Warp overloads by type
    """Return the gap [m], positive outside, and its gradient in the pad's frame."""
    gap, n = surface_distance(body.surface, local_point(body, x))
    return gap, body.rotation * n


@wp.func
def nearby_gap(body: MeshBody, x: wp.vec3d):
    """Return the gap [m] and its gradient; far from the body too small a gap."""
    gap, n = nearby_distance(body.surface, local_point(body, x))
    return gap, body.rotation * n


@wp.func
def distance_curvature(body: Body, x: wp.vec3d) -> wp.mat33d:
    """Return the second derivative of the gap [1/m] in the pad's frame.

    A sharp rim's infinite curvature across the rim is left out: the gel's stiffness decides there.
    """
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    p = local_point(body, x)
    H = wp.mat33d()
    if body.is_ball:
        c = p - wp.vec3d(zero, zero, body.radius)
        length = wp.max(wp.length(c), wp.float64(1.0e-30))
        n = c / length
        H = (wp.identity(n=3, dtype=wp.float64) - wp.outer(n, n)) * (one / length)
    else:
        r = wp.max(wp.sqrt(p[0] * p[0] + p[1] * p[1]), wp.float64(1.0e-30))
        side = r - (body.radius - body.fillet)
        below = body.fillet - p[2]
        outward = wp.vec3d(p[0] / r, p[1] / r, zero)
        around = wp.vec3d(-outward[1], outward[0], zero)
        if side > zero and below > zero:
            corner = wp.max(wp.sqrt(side * side + below * below), wp.float64(1.0e-30))
            H = wp.outer(around, around) * (side / (corner * r))
            if body.fillet > zero:
                t = (outward * below + wp.vec3d(zero, zero, side)) / corner
                H += wp.outer(t, t) * (one / corner)
        elif side > below:
            H = wp.outer(around, around) * (one / r)
    return body.rotation * H * wp.transpose(body.rotation)


@wp.func  # type: ignore[no-redef]
def distance_curvature(body: MeshBody, x: wp.vec3d) -> wp.mat33d:  # noqa: ARG001, F811
    """Return zero: faces are flat, and edges are left out as a sharp rim is."""
    return wp.mat33d()
