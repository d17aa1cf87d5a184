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

from sim.contact.barrier import TouchedSurface, surface_point, tangential_part
from sim.contact.indenter_distance import BodyKernel, local_point, signed_distance


@wp.struct
class GripArrays:
    """``Grip`` on a device; each array has shape [face_count, face_point_count]."""

    held: wp.array2d(dtype=wp.int32)
    anchors: wp.array2d(dtype=wp.vec3d)
    loads: wp.array2d(dtype=wp.vec3d)


@wp.func
def _offset(body: Any, grip: GripArrays, f: wp.int32, q: wp.int32, x: wp.vec3d) -> wp.vec3d:
    """Return the tangential offset from the anchor in the pad's frame [m]."""
    p = wp.length(grip.loads[f, q])
    away = local_point(body, x) - grip.anchors[f, q]
    if p > wp.float64(0.0):
        away = tangential_part(away, grip.loads[f, q] / p)
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
    surface: TouchedSurface,
    body: Any,
    # Data in:
    positions: wp.array(dtype=wp.vec3d),
    normal_forces: wp.array2d(dtype=wp.vec3d),
    # Data in and out:
    grip: GripArrays,
):
    """Hold points that touch, free those that left, and take over pressure and normal."""
    f, q = wp.tid()
    x = surface_point(surface, positions, f, q)
    distance, n = signed_distance(body, x)
    if distance >= surface.distance:
        grip.held[f, q] = 0
        grip.loads[f, q] = wp.vec3d()
    else:
        if grip.held[f, q] == 0:
            grip.held[f, q] = 1
            grip.anchors[f, q] = _first_hold(
                body, grip.anchors[f, q], local_point(body, x), distance, surface.distance
            )
        p = wp.length(normal_forces[f, q]) / surface.areas[f, q]
        # Where there is no pressure yet, a tiny one carries the direction.
        grip.loads[f, q] = (wp.transpose(body.rotation) * n) * wp.max(p, wp.float64(1.0e-12))


@BodyKernel
@wp.kernel(enable_backward=False)
def drag(
    # Model:
    surface: TouchedSurface,
    body: Any,
    # Data in:
    positions: wp.array(dtype=wp.vec3d),
    # Data in and out:
    grip: GripArrays,
):
    """Bring the anchors of sliding points up to the slip length behind them.

    Those of free points come along, to know where they were last free.
    """
    f, q = wp.tid()
    if grip.held[f, q] == 0:
        grip.anchors[f, q] = local_point(body, surface_point(surface, positions, f, q))
    elif surface.bond == wp.float64(0.0):
        x = surface_point(surface, positions, f, q)
        u = _offset(body, grip, f, q, x)
        length = wp.length(u)
        if length > surface.slip:
            u = u * (surface.slip / length)
            grip.anchors[f, q] = local_point(body, x) - wp.transpose(body.rotation) * u


@BodyKernel
@wp.kernel(enable_backward=False)
def add_energy(
    # Model:
    surface: TouchedSurface,
    body: Any,
    # Data in:
    positions: wp.array(dtype=wp.vec3d),
    grip: GripArrays,
    # Data out:
    energy_out: wp.array2d(dtype=wp.float64),
):
    """Add the tangential energy of every point [J]."""
    f, q = wp.tid()
    if grip.held[f, q] == 1:
        x = surface_point(surface, positions, f, q)
        u = wp.length(_offset(body, grip, f, q, x))
        density = wp.float64(0.5) * surface.bond * u * u
        if surface.bond == wp.float64(0.0):
            y = u / surface.slip
            third = wp.float64(1.0) / wp.float64(3.0)
            share = y - third
            if y < wp.float64(1.0):
                share = y * y * (wp.float64(1.0) - y * third)
            density = surface.friction * wp.length(grip.loads[f, q]) * surface.slip * share
        energy_out[f, q] += surface.areas[f, q] * density


@BodyKernel
@wp.kernel(enable_backward=False)
def add_force(
    # Model:
    surface: TouchedSurface,
    body: Any,
    # Data in:
    positions: wp.array(dtype=wp.vec3d),
    grip: GripArrays,
    # Data out:
    force_out: wp.array2d(dtype=wp.vec3d),
    stiffness_out: wp.array2d(dtype=wp.mat33d),
):
    """Add the tangential force on the indenter [N] and its stiffness [N/m] of every point."""
    f, q = wp.tid()
    if grip.held[f, q] == 1:
        one = wp.float64(1.0)
        x = surface_point(surface, positions, f, q)
        u = _offset(body, grip, f, q, x)
        length = wp.length(u)
        across = surface.bond
        along = surface.bond
        if surface.bond == wp.float64(0.0):
            strength = surface.friction * wp.length(grip.loads[f, q])
            y = length / surface.slip
            if y < one:
                across = strength * (wp.float64(2.0) - y) / surface.slip
                along = strength * (wp.float64(2.0) - wp.float64(2.0) * y) / surface.slip
            else:
                across = strength / length
                along = wp.float64(0.0)
        tangent = wp.identity(n=3, dtype=wp.float64)
        p = wp.length(grip.loads[f, q])
        if p > wp.float64(0.0):
            n = body.rotation * (grip.loads[f, q] / p)
            tangent = tangent - wp.outer(n, n)
        K = tangent * across
        if length > wp.float64(1.0e-30):
            t = u / length
            K += wp.outer(t, t) * (along - across)
        force_out[f, q] = force_out[f, q] + u * (surface.areas[f, q] * across)
        stiffness_out[f, q] = stiffness_out[f, q] + K * surface.areas[f, q]
