"""Tangential contact: points that touch hold on to a place of the indenter, or slide from it.

A point that touches remembers where on the indenter it did so, its anchor. Its tangential offset u
from there costs, per area,

    bonded    k u^2 / 2
    friction  mu p s f(u / s),  f(y) = y^2 - y^3 / 3 for y < 1, y - 1/3 beyond

f is IPC's smoothed Coulomb law (Li et al. 2020, Eq. 14-16), but s is a length and u is counted from
the anchor, not from the last time step: a point that sticks does not creep, however many steps are
taken. Pressure p and normal are lagged: they are refreshed whenever the residual has become small,
until they stand still. Where u exceeds s, the anchor is then dragged along to that distance.

A point that comes to touch within a step takes hold where its gap fell to d_hat on a straight way,
so that gel running in under an edge is gripped from the start. Its anchor is where it was free, and
only the share c of the way that is left counts: u is c times the offset from there, at an energy of
1 / c. That is the same force as from an anchor on the way, but what is lagged is c, not a place
that would run after the point. When the step has ended, the place is the anchor.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from sim.contact.barrier import TouchedSurface, tangential_part
from sim.contact.indenter_distance import local_point, signed_distance

# Of its way, what a point has at least been held for that touches.
_LEAST_SHARE = wp.constant(wp.float64(1.0e-6))


@wp.struct
class GripArrays:
    """``Grip`` on a device; arrays have shape [environment_count, face_count, face_point_count]."""

    held: wp.array3d(dtype=wp.float64)
    anchors: wp.array3d(dtype=wp.vec3d)
    loads: wp.array3d(dtype=wp.vec3d)


@wp.func
def grip_offset(
    body: Any, held: wp.float64, load: wp.vec3d, anchor: wp.vec3d, x: wp.vec3d
) -> wp.vec3d:
    """Return the tangential offset in the pad's frame [m]: a share of that from the anchor."""
    p = wp.length(load)
    away = local_point(body, x) - anchor
    if p > wp.float64(0.0):
        away = tangential_part(away, load / p)
    return body.rotation * (held * away)


@wp.func
def share_held(body: Any, free: wp.vec3d, distance: wp.float64, reach: wp.float64) -> wp.float64:
    """Return the share of a straight way after its gap fell to ``reach``.

    Args:
        free: Where the point was last free, in the indenter's frame [m].
        distance: Where it is now [m].
    """
    before, _ = signed_distance(body, body.position + body.rotation * free)
    share = wp.float64(1.0)
    if before > reach:
        share = wp.max((reach - distance) / (before - distance), _LEAST_SHARE)
    return share


@wp.func
def tangential_contact(surface: TouchedSurface, b: wp.int32, load: wp.float64, length: wp.float64):
    """Return energy [J/m^2] and stiffness across and along an offset [Pa/m], at its length [m].

    ``load`` is the lagged pressure [Pa].
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


@wp.func
def held_back(
    surface: TouchedSurface,
    body: Any,
    grip: GripArrays,
    b: wp.int32,
    f: wp.int32,
    q: wp.int32,
    x: wp.vec3d,
):
    """Return energy [J/m^2] and its gradient [Pa] of what a point of an environment holds on to."""
    density = wp.float64(0.0)
    along = wp.vec3d()
    held = grip.held[b, f, q]
    if held > wp.float64(0.0):
        load = grip.loads[b, f, q]
        u = grip_offset(body, held, load, grip.anchors[b, f, q], x)
        whole, across, _stiffness = tangential_contact(surface, b, wp.length(load), wp.length(u))
        density = whole / held
        along = u * across
    return density, along
