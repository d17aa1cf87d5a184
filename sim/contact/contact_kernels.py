"""Warp kernels of contact between the gel's surface and the indenter: barrier, friction, bonding.

Barrier. It is integrated over the rest surface, so it converges under refinement:

    E = sum_p A_p kappa f(g_p / d_hat),  f(s) = s - 1 - ln s for s < 1, else 0

so the pressure is kappa / d_hat (1/s - 1). The barrier of Incremental Potential Contact (Li et al.
2020), -(s - 1)^2 ln s, lets the pressure vanish quadratically at d_hat; Newton then frees a point
by a factor of four an iteration, where this one frees it in one. Below s = extension the barrier
goes on as the parabola that joins it with two derivatives, so that Newton may start from a slight
overlap; an accepted equilibrium has every s above the extension, where that changes nothing.

Friction and bonding. A point that touches remembers where on the indenter it did so, its anchor.
Its tangential offset u from there costs, per area,

    bonded    k u^2 / 2
    friction  mu p s f(u / s),  f(y) = y^2 - y^3 / 3 for y < 1, y - 1/3 beyond

f is IPC's smoothed Coulomb law (Li et al. 2020, Eq. 14-16), but s is a length and u is counted from
the anchor, not from the last time step: a point that sticks does not creep, however many steps are
taken. Pressure p and normal are lagged: they are refreshed whenever the residual has become small,
until they stand still. Where u exceeds s, the anchor is then dragged along to that distance.

A point that comes to touch within a step takes hold where its gap fell to d_hat on a straight path,
so that gel running in under an edge is gripped from the start. Its anchor is where it was free, and
only the share c of the path that is left counts: u is c times the offset from there, at an energy
of 1 / c. That is the same force as from an anchor on the path, but what is lagged is c, not a place
that would run after the point. When the step has ended, the place is the anchor.

The kernels are compiled for one kind of indenter, analytic or of triangles, and for whether
anything resists along the surface, so that none carries what it does not need. All launch over
[environment_count, face_count, face_point_count], and skip environments that are not ``wanted``.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from sim.contact.indenter_distance import (
    Body,
    Poses,
    distance_curvature,
    local_point,
    nearby_gap,
    posed,
    signed_distance,
)
from sim.device import repeatable


@wp.struct
class TouchedSurface:
    """The faces that may be touched, and the numbers of the contact model."""

    faces: wp.array2d(dtype=wp.int32)  # nodes of every face, shape [face_count, face_node_count]
    # of the shape functions, shape [point_count, face_node_count]
    values: wp.array2d(dtype=wp.float64)
    # at rest, of every contact point [m^2], shape [face_count, point_count]
    areas: wp.array2d(dtype=wp.float64)
    young: wp.array(dtype=wp.float64)  # E of what is touched [Pa], shape [environment_count]
    # share of d_hat below which the barrier goes on as a parabola, the same shape
    extensions: wp.array(dtype=wp.float64)
    friction: wp.array(dtype=wp.float64)  # mu, the same shape
    stiffness: wp.array(dtype=wp.float64)  # kappa over E d_hat, the same shape
    distance: wp.float64  # d_hat [m]
    slip: wp.float64  # s [m], the offset at which sticking has become sliding
    bonded: wp.bool  # points that touch stick, with k = E / d_hat
    shift: wp.float64  # of ``repeatable`` for forces [N] and moments [N m]


@wp.func
def surface_point(
    surface: TouchedSurface, positions: wp.array(dtype=wp.vec3d), face: wp.int32, point: wp.int32
) -> wp.vec3d:
    """Return the position of a contact point [m]."""
    x = wp.vec3d()
    for k in range(surface.faces.shape[1]):
        x += positions[surface.faces[face, k]] * surface.values[point, k]
    return x


@wp.func
def tangential_part(v: wp.vec3d, n: wp.vec3d) -> wp.vec3d:
    """Return ``v`` without its component along the unit vector ``n``."""
    return v - n * wp.dot(v, n)


@wp.func
def normal_contact(surface: TouchedSurface, b: wp.int32, s: wp.float64):
    """Return energy [J/m^2], pressure [Pa] and its change by the gap [Pa/m] at gap s d_hat < d_hat.

    The pressure is the energy's derivative by the gap: it is negative where the surfaces repel.
    """
    one = wp.float64(1.0)
    r = wp.max(s, surface.extensions[b])
    h = s - r
    scale = surface.stiffness[b] * surface.young[b]
    energy = r - one - wp.log(r) + h * (one - one / r) + wp.float64(0.5) * h * h / (r * r)
    pressure = scale * (one - one / r + h / (r * r))
    change = scale / surface.distance * (one / (r * r))
    return scale * surface.distance * energy, pressure, change


@wp.kernel(enable_backward=False)
def hessian(
    # Model:
    blocks: wp.array3d(dtype=wp.int32),
    face_values: wp.array2d(dtype=wp.float64),
    # Data in:
    stiffness: wp.array2d(dtype=wp.mat33d),
    # Data out:
    values_out: wp.array(dtype=wp.mat33d),
):
    """Add a face's blocks to the matrix; launches over [face_count, face_node_count]."""
    f, i = wp.tid()
    active = wp.bool(False)
    for q in range(stiffness.shape[1]):
        if wp.ddot(stiffness[f, q], stiffness[f, q]) > wp.float64(0.0):
            active = True
    if active:
        for j in range(i, blocks.shape[2]):
            slot = blocks[f, i, j]
            if slot >= 0:
                total = wp.mat33d()
                for q in range(stiffness.shape[1]):
                    total += stiffness[f, q] * (face_values[q, i] * face_values[q, j])
                wp.atomic_add(values_out, slot // 2, total)


# Least share of its path for which a point that touches has been held.
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
    """Return the share of a straight path after its gap fell to ``reach``.

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


@wp.func
def held_stiffness(
    surface: TouchedSurface,
    body: Any,
    grip: GripArrays,
    b: wp.int32,
    f: wp.int32,
    q: wp.int32,
    x: wp.vec3d,
    least: wp.float64,
):
    """Return the traction [Pa] of what a point holds on to, and its stiffness [Pa/m].

    Along the offset the stiffness is at least this share of that across it.
    """
    pull = wp.vec3d()
    stiffness = wp.mat33d()
    share = grip.held[b, f, q]
    if share > wp.float64(0.0):
        lagged = grip.loads[b, f, q]
        u = grip_offset(body, share, lagged, grip.anchors[b, f, q], x)
        length = wp.length(u)
        load = wp.length(lagged)
        _more, across, along = tangential_contact(surface, b, load, length)
        tangent = wp.identity(n=3, dtype=wp.float64)
        if load > wp.float64(0.0):
            held = body.rotation * (lagged / load)
            tangent = tangent - wp.outer(held, held)
        stiffness += tangent * (share * across)
        if length > wp.float64(1.0e-30):
            t = u / length
            stiffness += wp.outer(t, t) * (share * (wp.max(along, least * across) - across))
        pull = u * across
    return pull, stiffness


# A preconditioner that knows nothing of a sliding point's way back to sticking steps too far.
_LEAST_ALONG = wp.constant(wp.float64(0.3))
# Of d_hat: a point that is so much nearer touches with all of its area. One that has just come to
# touch adds little, so that the load's correction by the area finds an end.
_FULLY = wp.constant(wp.float64(0.03))
# A lagged pressure that is none.
_TINY_PA = wp.constant(wp.float64(1.0e-12))


@dataclass(frozen=True, slots=True)
class ContactKernels:
    """The kernels for one kind of body, with or without what resists along the surface."""

    touch: Any  # energies [J] and gaps [m]; adds forces [N] to the nodes
    # Position and gap [m] of every point, force on the indenter [N] and its stiffness [N/m]
    force: Any
    # Holds points that touch and frees the others; takes over their pressure, corrects what
    # ``touch`` gave, and tells the pressure's change and size [N]
    hold: Any
    drag: Any  # lets anchors of sliding points follow
    stiffen: Any  # semidefinite stiffness of every point [N/m], and which nodes are touched
    # Adds force [N] and moment about the tip [N m] on the indenter, what touches of the area at
    # rest [m^2], and a quadratic form of every face's pressures [N^2/m^2], all summed up
    wrench: Any
    # Adds pressure and shear on the gel, times the area at rest [N], to the nodes around every
    # point, by shares that are nowhere negative
    spread: Any


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
            term = repeatable(force * surface.values[q, k], surface.shift)
            wp.atomic_add(nodes, b, surface.faces[f, k], term)


@cache
def contact_kernels(body_kind: Any, *, grips: bool) -> ContactKernels:
    """Build the kernels."""
    gap_of = signed_distance if body_kind is Body else nearby_gap

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
            exact = wp.float64(0.0)
            along, tangent = held_stiffness(surface, here, grip, b, f, q, x, exact)
            pull += along
            stiffness += tangent
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
        # ``start`` is what was held before the step; of a free point, where it was. Where n is
        # ``wanted``, 1/n of the pressure's change is taken over.
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
            if wanted[b] > 1:
                share = wp.float64(1.0) / wp.float64(wanted[b])
                load = wp.lerp(grip.loads[b, f, q], load, share)
                held = wp.lerp(grip.held[b, f, q], held, share)
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

    @wp.kernel(enable_backward=False, module="unique")
    def stiffen(
        # Model:
        surface: TouchedSurface,
        body: Any,
        numbers: wp.array2d(dtype=wp.int32),
        # Data in:
        wanted: wp.array(dtype=wp.int32),
        poses: Poses,
        grip: GripArrays,
        positions: wp.array2d(dtype=wp.vec3d),
        # Data out:
        stiffness_out: wp.array3d(dtype=wp.mat33f),
        touching_out: wp.array2d(dtype=wp.int32),
    ):
        # ``numbers`` are those of the faces' nodes among the surface's, -1 for what is fixed.
        b, f, q = wp.tid()
        if wanted[b] == 1:
            x = surface_point(surface, positions[b], f, q)
            here = posed(body, poses, b)
            distance, n = gap_of(here, x)
            stiffness = wp.mat33d()
            if distance < surface.distance:
                _energy, _slope, change = normal_contact(surface, b, distance / surface.distance)
                stiffness = wp.outer(n, n) * change
            if wp.static(grips):
                _along, tangent = held_stiffness(surface, here, grip, b, f, q, x, _LEAST_ALONG)
                stiffness += tangent
            stiffness_out[b, f, q] = wp.mat33f(stiffness * surface.areas[f, q])
            if wp.trace(stiffness) > wp.float64(0.0):
                for k in range(surface.faces.shape[1]):
                    if numbers[f, k] >= 0:
                        touching_out[b, numbers[f, k]] = 1

    @wp.kernel(enable_backward=False, module="unique")
    def wrench(
        # Model:
        surface: TouchedSurface,
        body: Any,
        # Data in:
        wanted: wp.array(dtype=wp.int32),
        poses: Poses,
        grip: GripArrays,
        positions: wp.array2d(dtype=wp.vec3d),
        form: wp.array2d(dtype=wp.float64),
        # Data out:
        wrench_out: wp.array2d(dtype=wp.float64),
    ):
        b, f, q = wp.tid()
        if wanted[b] == 1:
            x = surface_point(surface, positions[b], f, q)
            here = posed(body, poses, b)
            distance, n = gap_of(here, x)
            v = wp.vec3d()
            if distance < surface.distance:
                _density, slope, _change = normal_contact(surface, b, distance / surface.distance)
                v = n * slope
                touched = (surface.distance - distance) / (_FULLY * surface.distance)
                area = surface.areas[f, q] * wp.min(touched, wp.float64(1.0))
                area = repeatable(area, surface.shift / surface.young[b])
                wp.atomic_add(wrench_out, b, 6, area)
                formed = wp.float64(0.0)
                for r in range(surface.areas.shape[1]):
                    there, _n = gap_of(here, surface_point(surface, positions[b], f, r))
                    if there < surface.distance:
                        s = there / surface.distance
                        _density, pressed, _change = normal_contact(surface, b, s)
                        formed += form[q, r] * pressed
                formed = surface.areas[f, q] * slope * formed
                formed = repeatable(formed, surface.shift * surface.young[b])
                wp.atomic_add(wrench_out, b, 7, formed)
            if wp.static(grips):
                _more, along = held_back(surface, here, grip, b, f, q, x)
                v += along
            if wp.dot(v, v) > wp.float64(0.0):
                force = repeatable(v * surface.areas[f, q], surface.shift)
                moment = repeatable(wp.cross(x - poses.tips[b], force), surface.shift)
                for k in range(3):
                    wp.atomic_add(wrench_out, b, k, force[k])
                    wp.atomic_add(wrench_out, b, 3 + k, moment[k])

    @wp.kernel(enable_backward=False, module="unique")
    def spread(
        # Model:
        surface: TouchedSurface,
        body: Any,
        hats: wp.array2d(dtype=wp.float64),
        # Data in:
        poses: Poses,
        grip: GripArrays,
        positions: wp.array2d(dtype=wp.vec3d),
        # Data out:
        pressed_out: wp.array2d(dtype=wp.float64),
        sheared_out: wp.array2d(dtype=wp.vec3d),
    ):
        b, f, q = wp.tid()
        x = surface_point(surface, positions[b], f, q)
        here = posed(body, poses, b)
        distance, _n = gap_of(here, x)
        if distance < surface.distance:
            _density, slope, _change = normal_contact(surface, b, distance / surface.distance)
            along = wp.vec3d()
            if wp.static(grips):
                _more, along = held_back(surface, here, grip, b, f, q, x)
            for k in range(surface.faces.shape[1]):
                share = hats[q, k] * surface.areas[f, q]
                if share > wp.float64(0.0):
                    pressed = repeatable(-slope * share, surface.shift)
                    wp.atomic_add(pressed_out, b, surface.faces[f, k], pressed)
                    sheared = repeatable(-along * share, surface.shift)
                    wp.atomic_add(sheared_out, b, surface.faces[f, k], sheared)

    def built(kernel: Any) -> Any:
        return wp.overload(kernel, {"body": body_kind})

    return ContactKernels(
        *(built(each) for each in (touch, force, hold, drag, stiffen, wrench, spread))
    )
