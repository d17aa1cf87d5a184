"""Tangential contact: points that touch hold on to a place of the indenter, or slide from it.

A point that touches remembers where on the indenter it did so, its anchor. Its tangential offset u
from there costs, per area,

    bonded    k u^2 / 2
    friction  mu p s f(u / s),  f(y) = y^2 - y^3 / 3 for y < 1, y - 1/3 beyond

f is IPC's smoothed Coulomb law (Li et al. 2020, Eq. 14-16), but s is a length and u is counted from
the anchor, not from the last time step: a point that sticks does not creep, however many steps are
taken. Pressure p and normal are lagged: they are refreshed when Newton has ended and Newton is run
again until they stand still. Where u exceeds s, the anchor is then dragged along to that distance.
A point that comes to touch within a step takes hold where its gap fell to d_hat on the way, so that
gel running in under an edge is gripped from the start.

Kernels launch over [face_count, face_point_count].
"""

from __future__ import annotations

from typing import Any

import warp as wp

from sim.contact.barrier import surface_point, tangential_part
from sim.contact.indenter_distance import BodyKernel, local_point, signed_distance


@wp.struct
class GripSettings:
    """Numbers of tangential contact.

    Attributes:
        reach: d_hat [m]: points nearer than this hold on.
        stiffness: k [Pa/m]; positive only where points are bonded.
        coefficient: mu.
        slip: s [m], the offset at which sticking has become sliding.
    """

    reach: wp.float64
    stiffness: wp.float64
    coefficient: wp.float64
    slip: wp.float64


@wp.func
def _offset(body: Any, anchor: wp.vec3d, load: wp.vec3d, x: wp.vec3d) -> wp.vec3d:
    """Return the tangential offset from the anchor in the pad's frame [m]."""
    p = wp.length(load)
    away = local_point(body, x) - anchor
    if p > wp.float64(0.0):
        away = tangential_part(away, load / p)
    return body.rotation * away


@wp.func
def _first_hold(
    body: Any, free: wp.vec3d, here: wp.vec3d, distance: wp.float64, reach: wp.float64
) -> wp.vec3d:
    """Return where a gap fell to ``reach`` on a straight way, in the indenter's frame [m].

    Args:
        free: Where the point was last free.
        here: Where it is, at ``distance``.
    """
    before, _ = signed_distance(body, body.position + body.rotation * free)
    if before <= reach:
        return here
    return free + (here - free) * ((before - reach) / (before - distance))


@BodyKernel
@wp.kernel(enable_backward=False)
def refresh(
    # Model:
    faces: wp.array2d(dtype=wp.int32),
    face_values: wp.array2d(dtype=wp.float64),
    areas: wp.array2d(dtype=wp.float64),
    settings: GripSettings,
    body: Any,
    # Data in:
    positions: wp.array(dtype=wp.vec3d),
    normal_forces: wp.array2d(dtype=wp.vec3d),
    # Data out:
    held_out: wp.array2d(dtype=wp.int32),
    anchor_out: wp.array2d(dtype=wp.vec3d),
    load_out: wp.array2d(dtype=wp.vec3d),
):
    """Hold points that touch, free those that left, and take over pressure and normal."""
    f, q = wp.tid()
    x = surface_point(faces, face_values, positions, f, q)
    distance, n = signed_distance(body, x)
    if distance >= settings.reach:
        held_out[f, q] = 0
        load_out[f, q] = wp.vec3d()
    else:
        if held_out[f, q] == 0:
            held_out[f, q] = 1
            anchor_out[f, q] = _first_hold(
                body, anchor_out[f, q], local_point(body, x), distance, settings.reach
            )
        p = wp.length(normal_forces[f, q]) / areas[f, q]
        # Where there is no pressure yet, a tiny one carries the direction.
        load_out[f, q] = (wp.transpose(body.rotation) * n) * wp.max(p, wp.float64(1.0e-12))


@BodyKernel
@wp.kernel(enable_backward=False)
def drag(
    # Model:
    faces: wp.array2d(dtype=wp.int32),
    face_values: wp.array2d(dtype=wp.float64),
    settings: GripSettings,
    body: Any,
    # Data in:
    positions: wp.array(dtype=wp.vec3d),
    held: wp.array2d(dtype=wp.int32),
    loads: wp.array2d(dtype=wp.vec3d),
    # Data out:
    anchor_out: wp.array2d(dtype=wp.vec3d),
):
    """Bring the anchors of sliding points up to the slip length behind them.

    Those of free points come along, to know where they were last free.
    """
    f, q = wp.tid()
    if held[f, q] == 0:
        anchor_out[f, q] = local_point(body, surface_point(faces, face_values, positions, f, q))
    elif settings.stiffness == wp.float64(0.0):
        x = surface_point(faces, face_values, positions, f, q)
        u = _offset(body, anchor_out[f, q], loads[f, q], x)
        length = wp.length(u)
        if length > settings.slip:
            u = u * (settings.slip / length)
            anchor_out[f, q] = local_point(body, x) - wp.transpose(body.rotation) * u


@BodyKernel
@wp.kernel(enable_backward=False)
def add_energy(
    # Model:
    faces: wp.array2d(dtype=wp.int32),
    face_values: wp.array2d(dtype=wp.float64),
    areas: wp.array2d(dtype=wp.float64),
    settings: GripSettings,
    body: Any,
    # Data in:
    positions: wp.array(dtype=wp.vec3d),
    held: wp.array2d(dtype=wp.int32),
    anchors: wp.array2d(dtype=wp.vec3d),
    loads: wp.array2d(dtype=wp.vec3d),
    # Data out:
    energy_out: wp.array2d(dtype=wp.float64),
):
    """Add the tangential energy of every point [J]."""
    f, q = wp.tid()
    if held[f, q] == 1:
        x = surface_point(faces, face_values, positions, f, q)
        u = wp.length(_offset(body, anchors[f, q], loads[f, q], x))
        density = wp.float64(0.5) * settings.stiffness * u * u
        if settings.stiffness == wp.float64(0.0):
            y = u / settings.slip
            third = wp.float64(1.0) / wp.float64(3.0)
            share = y - third
            if y < wp.float64(1.0):
                share = y * y * (wp.float64(1.0) - y * third)
            density = settings.coefficient * wp.length(loads[f, q]) * settings.slip * share
        energy_out[f, q] += areas[f, q] * density


@BodyKernel
@wp.kernel(enable_backward=False)
def add_force(
    # Model:
    faces: wp.array2d(dtype=wp.int32),
    face_values: wp.array2d(dtype=wp.float64),
    areas: wp.array2d(dtype=wp.float64),
    settings: GripSettings,
    body: Any,
    # Data in:
    positions: wp.array(dtype=wp.vec3d),
    held: wp.array2d(dtype=wp.int32),
    anchors: wp.array2d(dtype=wp.vec3d),
    loads: wp.array2d(dtype=wp.vec3d),
    # Data out:
    force_out: wp.array2d(dtype=wp.vec3d),
    stiffness_out: wp.array2d(dtype=wp.mat33d),
):
    """Add the tangential force on the indenter [N] and its stiffness [N/m] of every point."""
    f, q = wp.tid()
    if held[f, q] == 1:
        one = wp.float64(1.0)
        x = surface_point(faces, face_values, positions, f, q)
        u = _offset(body, anchors[f, q], loads[f, q], x)
        length = wp.length(u)
        across = settings.stiffness
        along = settings.stiffness
        if settings.stiffness == wp.float64(0.0):
            strength = settings.coefficient * wp.length(loads[f, q])
            y = length / settings.slip
            if y < one:
                across = strength * (wp.float64(2.0) - y) / settings.slip
                along = strength * (wp.float64(2.0) - wp.float64(2.0) * y) / settings.slip
            else:
                across = strength / length
                along = wp.float64(0.0)
        tangent = wp.identity(n=3, dtype=wp.float64)
        p = wp.length(loads[f, q])
        if p > wp.float64(0.0):
            n = body.rotation * (loads[f, q] / p)
            tangent = tangent - wp.outer(n, n)
        K = tangent * across
        if length > wp.float64(1.0e-30):
            t = u / length
            K += wp.outer(t, t) * (along - across)
        force_out[f, q] = force_out[f, q] + u * (areas[f, q] * across)
        stiffness_out[f, q] = stiffness_out[f, q] + K * areas[f, q]
