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

from sim.contact.barrier import TouchedSurface, normal_contact, tangential_part
from sim.contact.indenter_distance import local_point, signed_distance

_TINY_PA = wp.constant(wp.float64(1.0e-12))


@wp.struct
class GripArrays:
    """``Grip`` on a device; arrays have shape [environment_count, face_count, face_point_count]."""

    held: wp.array3d(dtype=wp.int32)
    anchors: wp.array3d(dtype=wp.vec3d)
    loads: wp.array3d(dtype=wp.vec3d)


@wp.func
def grip_offset(body: Any, load: wp.vec3d, anchor: wp.vec3d, x: wp.vec3d) -> wp.vec3d:
    """Return the tangential offset from an anchor in the pad's frame [m]."""
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


@wp.func
def taken_hold(
    surface: TouchedSurface,
    body: Any,
    x: wp.vec3d,
    b: wp.int32,
    f: wp.int32,
    q: wp.int32,
    was_held: wp.int32,
    anchor: wp.vec3d,
    grip: GripArrays,
):
    """Hold a point that touches, free one that left, and take over pressure [Pa] and normal.

    Args:
        was_held: 1 where it was held before,
        anchor: and there; where it was last, for one that was free [m].
        grip: What is held from now on.
    """
    distance, n = signed_distance(body, x)
    held = wp.int32(0)
    load = wp.vec3d()
    if distance < surface.distance:
        held = wp.int32(1)
        if was_held == 0:
            here = local_point(body, x)
            anchor = _first_hold(body, anchor, here, distance, surface.distance)
        _energy, slope, _change = normal_contact(surface, b, distance / surface.distance)
        # Where there is no pressure yet, a tiny one carries the direction.
        load = (wp.transpose(body.rotation) * n) * wp.max(-slope, _TINY_PA)
    grip.held[b, f, q] = held
    grip.anchors[b, f, q] = anchor
    grip.loads[b, f, q] = load


@wp.func
def dragged(
    surface: TouchedSurface,
    body: Any,
    x: wp.vec3d,
    b: wp.int32,
    f: wp.int32,
    q: wp.int32,
    grip: GripArrays,
):
    """Bring the anchor of a sliding point up to the slip length behind it.

    That of a free point comes along, to know where it was last free.
    """
    if grip.held[b, f, q] == 0:
        grip.anchors[b, f, q] = local_point(body, x)
    elif not surface.bonded:
        u = grip_offset(body, grip.loads[b, f, q], grip.anchors[b, f, q], x)
        length = wp.length(u)
        if length > surface.slip:
            u = u * (surface.slip / length)
            grip.anchors[b, f, q] = local_point(body, x) - wp.transpose(body.rotation) * u


@wp.func
def tangential_contact(surface: TouchedSurface, b: wp.int32, load: wp.float64, length: wp.float64):
    """Return energy [J/m^2] and stiffness across and along an offset [Pa/m], at its length [m].

    Args:
        load: Lagged pressure [Pa].
    """
    one = wp.float64(1.0)
    bond = surface.young[b] / surface.distance
    across = bond
    along = bond
    density = wp.float64(0.5) * bond * length * length
    if not surface.bonded:
        strength = surface.friction[b] * load
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
