"""Warp kernels of contact: barrier and what acts along the surface, point by point.

They are compiled for what presses, an analytic body or one of triangles, and for whether anything
resists along the surface, so that none carries what it does not need. All launch over
[environment_count, face_count, face_point_count], and leave environments alone that are not
``wanted``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from sim.contact.barrier import TouchedSurface, normal_contact, surface_point
from sim.contact.friction import (
    GripArrays,
    grip_offset,
    held_back,
    share_held,
    tangential_contact,
)
from sim.contact.indenter_distance import (
    MeshBody,
    Poses,
    distance_curvature,
    local_point,
    nearby_gap,
    posed,
    signed_distance,
)

# A lagged pressure that is none.
_TINY_PA = wp.constant(wp.float64(1.0e-12))


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactKernels:
    """The kernels for one kind of body, with or without what resists along the surface.

    Attributes:
        touch: Energies [J] and gaps [m]; adds forces [N] to the nodes.
        force: Position and gap [m] of every point, force on the indenter [N] and its stiffness
            [N/m].
        hold: Holds points that touch and frees the others; takes over their pressure, corrects
            what ``touch`` gave, and tells the pressure's change and size [N].
        drag: Lets anchors of sliding points follow.
    """

    touch: Any
    force: Any
    hold: Any
    drag: Any


@wp.func
def add_traction(
    surface: TouchedSurface,
    b: wp.int32,
    f: wp.int32,
    q: wp.int32,
    traction: wp.vec3d,
    nodes: wp.array2d(dtype=wp.vec3d),
):
    """Add what a point's traction [Pa] is to its face's nodes [N]."""
    if wp.dot(traction, traction) > wp.float64(0.0):
        force = traction * surface.areas[f, q]
        for k in range(surface.faces.shape[1]):
            wp.atomic_add(nodes, b, surface.faces[f, k], force * surface.values[q, k])


@cache
def contact_kernels(body_kind: Any, *, grips: bool) -> ContactKernels:
    """Build the kernels."""
    gap_of = nearby_gap if body_kind is MeshBody else signed_distance

    @wp.kernel(enable_backward=False, module="unique")
    def touch(
        # Model:
        surface: TouchedSurface,
        body: Any,
        # Data in:
        wanted: wp.array(dtype=wp.int32),
        poses: Poses,
        grip: GripArrays,
        positions: wp.array2d(dtype=wp.vec3d),
        # Data out:
        nodes_out: wp.array2d(dtype=wp.vec3d),
        energy_out: wp.array3d(dtype=wp.float64),
        gap_out: wp.array3d(dtype=wp.float64),
    ):
        b, f, q = wp.tid()
        if wanted[b] == 1:
            x = surface_point(surface, positions[b], f, q)
            here = posed(body, poses, b)
            distance, n = gap_of(here, x)
            density = wp.float64(0.0)
            v = wp.vec3d()
            if distance < surface.distance:
                density, slope, _change = normal_contact(surface, b, distance / surface.distance)
                v = n * slope
            if wp.static(grips):
                more, along = held_back(surface, here, grip, b, f, q, x)
                density += more
                v += along
            energy_out[b, f, q] = surface.areas[f, q] * density
            gap_out[b, f, q] = distance
            add_traction(surface, b, f, q, v, nodes_out)

    @wp.kernel(enable_backward=False, module="unique")
    def force(
        # Model:
        surface: TouchedSurface,
        body: Any,
        # Data in:
        poses: Poses,
        grip: GripArrays,
        positions: wp.array2d(dtype=wp.vec3d),
        curved: wp.bool,
        # Data out:
        point_out: wp.array3d(dtype=wp.vec3d),
        gap_out: wp.array3d(dtype=wp.float64),
        force_out: wp.array3d(dtype=wp.vec3d),
        stiffness_out: wp.array3d(dtype=wp.mat33d),
    ):
        # With ``curved`` the stiffness is exact; without, the indenter's curvature is left out,
        # which keeps it positive semidefinite.
        b, f, q = wp.tid()
        x = surface_point(surface, positions[b], f, q)
        here = posed(body, poses, b)
        distance, n = signed_distance(here, x)
        pull = wp.vec3d()
        stiffness = wp.mat33d()
        if distance < surface.distance:
            _energy, slope, change = normal_contact(surface, b, distance / surface.distance)
            pull = n * slope
            stiffness = wp.outer(n, n) * change
            if curved:
                stiffness += distance_curvature(here, x) * slope
        if wp.static(grips):
            share = grip.held[b, f, q]
            if share > wp.float64(0.0):
                lagged = grip.loads[b, f, q]
                u = grip_offset(here, share, lagged, grip.anchors[b, f, q], x)
                length = wp.length(u)
                load = wp.length(lagged)
                _more, across, along = tangential_contact(surface, b, load, length)
                tangent = wp.identity(n=3, dtype=wp.float64)
                if load > wp.float64(0.0):
                    held = here.rotation * (lagged / load)
                    tangent = tangent - wp.outer(held, held)
                stiffness += tangent * (share * across)
                if length > wp.float64(1.0e-30):
                    t = u / length
                    stiffness += wp.outer(t, t) * (share * (along - across))
                pull += u * across
        point_out[b, f, q] = x
        gap_out[b, f, q] = distance
        force_out[b, f, q] = pull * surface.areas[f, q]
        stiffness_out[b, f, q] = stiffness * surface.areas[f, q]

    @wp.kernel(enable_backward=False, module="unique")
    def hold(
        # Model:
        surface: TouchedSurface,
        body: Any,
        # Data in:
        wanted: wp.array(dtype=wp.int32),
        poses: Poses,
        positions: wp.array2d(dtype=wp.vec3d),
        start: GripArrays,
        # Data in and out:
        grip: GripArrays,
        nodes: wp.array2d(dtype=wp.vec3d),
        energy: wp.array3d(dtype=wp.float64),
        # Data out:
        change_out: wp.array3d(dtype=wp.float64),
        limit_out: wp.array3d(dtype=wp.float64),
    ):
        # ``start`` is what was held before the step; of a free point, where it was.
        b, f, q = wp.tid()
        if wanted[b] > 0:
            x = surface_point(surface, positions[b], f, q)
            here = posed(body, poses, b)
            distance, n = signed_distance(here, x)
            before, pulled = held_back(surface, here, grip, b, f, q, x)
            held = wp.float64(0.0)
            anchor = start.anchors[b, f, q]
            load = wp.vec3d()
            if distance < surface.distance:
                held = wp.float64(1.0)
                if start.held[b, f, q] == wp.float64(0.0):
                    if surface.bonded:
                        anchor = local_point(here, x)
                    else:
                        held = share_held(here, anchor, distance, surface.distance)
                _energy, slope, _change = normal_contact(surface, b, distance / surface.distance)
                # Where there is no pressure yet, a tiny one carries the direction.
                load = (wp.transpose(here.rotation) * n) * wp.max(-slope, _TINY_PA)
            change_out[b, f, q] = surface.areas[f, q] * wp.length(load - grip.loads[b, f, q])
            limit_out[b, f, q] = surface.areas[f, q] * wp.length(load)
            if wanted[b] == 2:
                load = (load + grip.loads[b, f, q]) * wp.float64(0.5)
                held = (held + grip.held[b, f, q]) * wp.float64(0.5)
            grip.held[b, f, q] = held
            grip.anchors[b, f, q] = anchor
            grip.loads[b, f, q] = load
            density, pull = held_back(surface, here, grip, b, f, q, x)
            energy[b, f, q] += surface.areas[f, q] * (density - before)
            add_traction(surface, b, f, q, pull - pulled, nodes)

    @wp.kernel(enable_backward=False, module="unique")
    def drag(
        # Model:
        surface: TouchedSurface,
        body: Any,
        # Data in:
        wanted: wp.array(dtype=wp.int32),
        poses: Poses,
        positions: wp.array2d(dtype=wp.vec3d),
        # Data in and out:
        grip: GripArrays,
    ):
        b, f, q = wp.tid()
        if wanted[b] == 1:
            # An anchor is brought up to the offset behind its point, the slip length at most; that
            # of a free point comes along, to know where it was last free.
            x = surface_point(surface, positions[b], f, q)
            here = posed(body, poses, b)
            at = local_point(here, x)
            held = grip.held[b, f, q]
            if held == wp.float64(0.0):
                grip.anchors[b, f, q] = at
            else:
                u = grip_offset(here, held, grip.loads[b, f, q], grip.anchors[b, f, q], x)
                length = wp.length(u)
                slides = length > surface.slip and not surface.bonded
                if slides:
                    u = u * (surface.slip / length)
                if slides or held < wp.float64(1.0):
                    grip.anchors[b, f, q] = at - wp.transpose(here.rotation) * u
                    grip.held[b, f, q] = wp.float64(1.0)

    def built(kernel: Any) -> Any:
        return wp.overload(kernel, {"body": body_kind})

    return ContactKernels(
        touch=built(touch), force=built(force), hold=built(hold), drag=built(drag)
    )
