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
"""

from __future__ import annotations

from typing import Any

import warp as wp

from sim.contact.barrier import TouchedSurface, tangential_part
from sim.contact.indenter_distance import local_point, signed_distance

_TINY_PA = wp.constant(wp.float64(1.0e-12))


@wp.struct
class GripArrays:
    """``Grip`` on a device; each array has shape [face_count, face_point_count]."""

    held: wp.array2d(dtype=wp.int32)
    anchors: wp.array2d(dtype=wp.vec3d)
    loads: wp.array2d(dtype=wp.vec3d)


@wp.func
def grip_offset(body: Any, grip: GripArrays, f: wp.int32, q: wp.int32, x: wp.vec3d) -> wp.vec3d:
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


@wp.func
def taken_hold(
    surface: TouchedSurface,
    body: Any,
    x: wp.vec3d,
    pressure: wp.float64,
    f: wp.int32,
    q: wp.int32,
    grip: GripArrays,
):
    """Hold a point that touches, free one that left, and take over pressure [Pa] and normal."""
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
        # Where there is no pressure yet, a tiny one carries the direction.
        grip.loads[f, q] = (wp.transpose(body.rotation) * n) * wp.max(pressure, _TINY_PA)


@wp.func
def dragged(
    surface: TouchedSurface, body: Any, x: wp.vec3d, f: wp.int32, q: wp.int32, grip: GripArrays
):
    """Bring the anchor of a sliding point up to the slip length behind it.

    That of a free point comes along, to know where it was last free.
    """
    if grip.held[f, q] == 0:
        grip.anchors[f, q] = local_point(body, x)
    elif surface.bond == wp.float64(0.0):
        u = grip_offset(body, grip, f, q, x)
        length = wp.length(u)
        if length > surface.slip:
            u = u * (surface.slip / length)
            grip.anchors[f, q] = local_point(body, x) - wp.transpose(body.rotation) * u


@wp.func
def tangential_contact(surface: TouchedSurface, load: wp.float64, length: wp.float64):
    """Return energy [J/m^2] and stiffness across and along an offset [Pa/m], at its length [m].

    Args:
        load: Lagged pressure [Pa].
    """
    one = wp.float64(1.0)
    across = surface.bond
    along = surface.bond
    density = wp.float64(0.5) * surface.bond * length * length
    if surface.bond == wp.float64(0.0):
        strength = surface.friction * load
        y = length / surface.slip
        third = one / wp.float64(3.0)
        if y < one:
            across = strength * (wp.float64(2.0) - y) / surface.slip
            along = strength * (wp.float64(2.0) - wp.float64(2.0) * y) / surface.slip
            density = strength * surface.slip * (y * y * (one - y * third))
        else:
            across = strength / length
            along = wp.float64(0.0)
            density = strength * surface.slip * (y - third)
    return density, across, along
