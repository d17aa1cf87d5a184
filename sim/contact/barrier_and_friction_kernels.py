"""Warp kernels of contact between the gel's surface and the indenter: barrier, friction, bonding.

docs/explanation/contact.md has the energies and their sources; here its slip length l is ``slip``.
Newton frees a point by a factor of four an iteration with IPC's barrier -(s - 1)^2 ln s, in one
with this. Below s = extension the barrier goes on as the parabola that joins it with two
derivatives, so that Newton may start from a slight overlap; an accepted equilibrium has every s
above the extension, where that changes nothing.

Pressure and normal of friction are lagged: they are refreshed whenever the residual has become
small, until they stand still. A point that comes to touch within a step takes hold where its gap
fell to d_hat on a straight path, so that gel running in under an edge is gripped from the start.
Its anchor is where it was free, and only the share c of the path that is left counts: u is c times
the offset from there, at an energy of 1 / c. That is the same force as from an anchor on the path,
but what is lagged is c, not a place that would run after the point. When the step has ended, the
place is the anchor.

The kernels are compiled for whether anything resists along the surface. All but ``wrench`` launch
over [environment_count, face_count, face_point_count], and skip environments not ``wanted``.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from sim.contact.indenter_distance import Body, Poses, local_point, nearby_gap, posed
from sim.device import repeatable
from sim.scene.triangle_distance import nearby_distance


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
    slip: wp.float64  # [m], the offset at which sticking has become sliding
    bonded: wp.bool  # points that touch stick, with k = E / d_hat
    shift: wp.float64  # of ``repeatable`` for forces [N] and moments [N m]


@wp.func
def tangential_part(v: wp.vec3d, n: wp.vec3d) -> wp.vec3d:
    """Return ``v`` without its component along the unit vector ``n``."""
    return v - n * wp.dot(v, n)


@wp.func
def normal_contact(surface: TouchedSurface, b: wp.int32, gap: wp.float64):
    """Return energy [J/m^2], pressure [Pa] and its change by the gap [Pa/m], at a gap [m].

    The pressure is the energy's derivative by the gap: it is negative where the surfaces repel.
    """
    one = wp.float64(1.0)
    if gap >= surface.distance:
        return wp.float64(0.0), wp.float64(0.0), wp.float64(0.0)
    s = gap / surface.distance
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


# A reach within which every gap is exact [m].
_ALL_M = wp.constant(wp.float64(1.0e3))
# Of d_hat: as far as triangles are looked for, so that who is off them may move unsought.
_LOOKED = wp.constant(wp.float64(4.0))
# Least share of its path for which a point that touches has been held.
_LEAST_SHARE = wp.constant(wp.float64(1.0e-6))


@wp.struct
class GripArrays:
    """``Grip`` on a device; arrays have shape [environment_count, face_count, face_point_count]."""

    held: wp.array3d(dtype=wp.float64)
    anchors: wp.array3d(dtype=wp.vec3d)
    loads: wp.array3d(dtype=wp.vec3d)


@wp.struct
class Seen:
    """Where a contact point was last sought from, in the indenter's frame, and what was found."""

    place: wp.vec3d  # [m]
    gap: wp.float64  # [m]; 0 at the outset
    normal: wp.vec3d
    next_face: wp.int32  # the number after the nearest face's; 0 if none is near


@wp.struct
class Pressed:
    """Surfaces of environments, where they are, and what presses them."""

    surface: TouchedSurface
    bodies: wp.array(dtype=Body)
    poses: Poses
    grip: GripArrays
    positions: wp.array2d(dtype=wp.vec3d)  # of the nodes [m], [environment_count, node_count]
    seen: wp.array3d(dtype=Seen)  # of every contact point, if triangles press; else empty


@wp.func
def met(at: Pressed, b: wp.int32, face: wp.int32, point: wp.int32):
    """Return an environment's indenter, and the position of a contact point [m]."""
    x = wp.vec3d()
    for k in range(at.surface.faces.shape[1]):
        x += at.positions[b, at.surface.faces[face, k]] * at.surface.values[point, k]
    return posed(at.bodies, at.poses, b), x


@wp.func
def gap_of(at: Pressed, body: Body, b: wp.int32, f: wp.int32, q: wp.int32, x: wp.vec3d):
    """Return a contact point's gap [m] and its gradient, exact up to d_hat.

    A gap changes by no more than the point moves: who was far enough off is not sought again.
    """
    reach = at.surface.distance
    if at.seen.shape[0] == 0:
        return nearby_gap(body, x, reach)
    p = local_point(body, x)
    last = at.seen[b, f, q]
    moved = wp.length(p - last.place)
    gap, n = last.gap - moved, wp.vec3d(last.normal)
    if gap <= reach and (moved > wp.float64(0.0) or last.gap == wp.float64(0.0)):
        gap, n, face = nearby_distance(body.surface, p, _LOOKED * reach, last.next_face - 1)
        at.seen[b, f, q] = Seen(p, gap, n, face + 1)  # type: ignore[call-arg]
    return gap, body.rotation * n


@wp.func
def grip_offset(
    body: Body, held: wp.float64, load: wp.vec3d, anchor: wp.vec3d, x: wp.vec3d
) -> wp.vec3d:
    """Return the tangential offset in the pad's frame [m]: a share of that from the anchor."""
    p = wp.length(load)
    away = local_point(body, x) - anchor
    if p > wp.float64(0.0):
        away = tangential_part(away, load / p)
    return body.rotation * (held * away)


@wp.func
def share_held(body: Body, free: wp.vec3d, distance: wp.float64, reach: wp.float64) -> wp.float64:
    """Return the share of a straight path after its gap fell to ``reach``.

    Args:
        free: Where the point was last free, in the indenter's frame [m].
        distance: Where it is now [m].
    """
    before, _ = nearby_gap(body, body.position + body.rotation * free, _ALL_M)
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
    at: Pressed, body: Body, b: wp.int32, f: wp.int32, q: wp.int32, x: wp.vec3d, least: wp.float64
):
    """Return energy [J/m^2] of what a point holds on to, its gradient [Pa] and stiffness [Pa/m].

    Along the offset the stiffness is at least this share of that across it.
    """
    density = wp.float64(0.0)
    pull = wp.vec3d()
    stiffness = wp.mat33d()
    share = at.grip.held[b, f, q]
    if share > wp.float64(0.0):
        lagged = at.grip.loads[b, f, q]
        u = grip_offset(body, share, lagged, at.grip.anchors[b, f, q], x)
        length = wp.length(u)
        load = wp.length(lagged)
        whole, across, along = tangential_contact(at.surface, b, load, length)
        density = whole / share
        pull = u * across
        tangent = wp.identity(n=3, dtype=wp.float64)
        if load > wp.float64(0.0):
            held = body.rotation * (lagged / load)
            tangent = tangent - wp.outer(held, held)
        stiffness = tangent * (share * across)
        if length > wp.float64(1.0e-30):
            t = u / length
            stiffness += wp.outer(t, t) * (share * (wp.max(along, least * across) - across))
    return density, pull, stiffness


# A preconditioner that knows nothing of a sliding point's way back to sticking steps too far.
LEAST_ALONG = 0.3
"""Of a preconditioner: least stiffness along a sliding point's way, over that across it."""
_LEAST_ALONG, _EXACT = wp.constant(wp.float64(LEAST_ALONG)), wp.constant(wp.float64(0.0))
# Of d_hat: a point that is so much nearer touches with all of its area. One that has just come to
# touch adds little, so that the load's correction by the area finds an end.
_FULLY = wp.constant(wp.float64(0.03))
# Where nothing reaches [m].
FAR_M = wp.constant(wp.float64(1e9))
WRENCH_THREADS = 512
"""Of a block on a GPU."""

_WrenchSums = wp.types.vector(length=9, dtype=wp.float64)
# A lagged pressure that is none.
_TINY_PA = wp.constant(wp.float64(1.0e-12))


@dataclass(frozen=True, slots=True)
class ContactKernels:
    """The kernels, with or without what resists along the surface."""

    touch: Any  # energies [J] and gaps [m]; adds forces [N] to the nodes
    # Position and gap [m] of every point, force on the indenter [N] and its stiffness [N/m]; along
    # a sliding point's way this is at least a share of that across it
    force: Any
    # Holds points that touch and frees the others; takes over their pressure, corrects what
    # ``touch`` gave, and tells the pressure's change and size [N]
    hold: Any
    drag: Any  # lets anchors of sliding points follow


@dataclass(frozen=True, slots=True)
class BatchKernels:
    """The kernels that only batches need, with or without what resists along the surface."""

    stiffen: Any  # semidefinite stiffness of every point [N/m], and which nodes are touched
    # Gives force [N] and moment about the tip [N m] on the indenter, what touches of the area at
    # rest [m^2] by several points of shape functions ``others`` for every one, and the square of
    # shear with a form of every face's pressures, times the face's share, summed up [N^2/m^2], and
    # what pressure adds up to [N] less its part along the indenter's axis. Then how far points
    # that may touch rest from the tip, along x, -x, y and -y [m]. Over [environment_count, threads
    # of a block]
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
def _contact_at(*, grips: bool) -> Any:
    """Build what a point's contact is."""

    @wp.func
    def contact_at(at: Pressed, b: wp.int32, f: wp.int32, q: wp.int32, least: wp.float64):
        """Return place and gap [m], energy [J/m^2], its gradient [Pa] and stiffness [Pa/m].

        The gradient is parted into that along the indenter's normal and that of what holds on.
        Without the indenter's curvature the stiffness is semidefinite; ``held_back`` has ``least``.
        """
        here, x = met(at, b, f, q)
        distance, n = gap_of(at, here, b, f, q, x)
        density, slope, change = normal_contact(at.surface, b, distance)
        along = wp.vec3d()
        stiffness = wp.outer(n, n) * change
        if wp.static(grips):
            more, held, tangent = held_back(at, here, b, f, q, x, least)
            density += more
            along += held
            stiffness += tangent
        return x, distance, density, n * slope, along, stiffness

    return contact_at


@cache
def contact_kernels(*, grips: bool) -> ContactKernels:
    """Build the kernels; in one Warp module, which hashes once what they have in common."""
    contact_at = _contact_at(grips=grips)
    module = f"{__name__}.{'with' if grips else 'no'}_grip"

    @wp.kernel(enable_backward=False, module=module)
    def touch(
        at: Pressed,
        # Data in:
        wanted: wp.array(dtype=wp.int32),
        # Data out:
        nodes_out: wp.array2d(dtype=wp.vec3d),
        energy_out: wp.array3d(dtype=wp.float64),
        gap_out: wp.array3d(dtype=wp.float64),
    ):
        b, f, q = wp.tid()
        if wanted[b] == 1:
            _x, distance, density, normal, along, _stiffness = contact_at(at, b, f, q, _EXACT)
            energy_out[b, f, q] = at.surface.areas[f, q] * density
            gap_out[b, f, q] = distance
            add_traction(at.surface, b, f, q, normal + along, nodes_out)

    @wp.kernel(enable_backward=False, module=module)
    def force(
        at: Pressed,
        least: wp.float64,
        # Data out:
        point_out: wp.array3d(dtype=wp.vec3d),
        gap_out: wp.array3d(dtype=wp.float64),
        force_out: wp.array3d(dtype=wp.vec3d),
        stiffness_out: wp.array3d(dtype=wp.mat33d),
    ):
        b, f, q = wp.tid()
        x, distance, _density, normal, along, stiffness = contact_at(at, b, f, q, least)
        point_out[b, f, q] = x
        gap_out[b, f, q] = distance
        force_out[b, f, q] = (normal + along) * at.surface.areas[f, q]
        stiffness_out[b, f, q] = stiffness * at.surface.areas[f, q]

    @wp.kernel(enable_backward=False, module=module)
    def hold(
        at: Pressed,
        # Data in:
        wanted: wp.array(dtype=wp.int32),
        start: GripArrays,
        # Data in and out:
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
            here, x = met(at, b, f, q)
            distance, n = gap_of(at, here, b, f, q, x)
            before, pulled, _tangent = held_back(at, here, b, f, q, x, _EXACT)
            held = wp.float64(0.0)
            anchor = start.anchors[b, f, q]
            load = wp.vec3d()
            if distance < at.surface.distance:
                held = wp.float64(1.0)
                if start.held[b, f, q] == wp.float64(0.0):
                    if at.surface.bonded:
                        anchor = local_point(here, x)
                    else:
                        held = share_held(here, anchor, distance, at.surface.distance)
                _energy, slope, _change = normal_contact(at.surface, b, distance)
                # Where there is no pressure yet, a tiny one carries the direction.
                load = (wp.transpose(here.rotation) * n) * wp.max(-slope, _TINY_PA)
            change_out[b, f, q] = at.surface.areas[f, q] * wp.length(load - at.grip.loads[b, f, q])
            limit_out[b, f, q] = at.surface.areas[f, q] * wp.length(load)
            if wanted[b] > 1:
                share = wp.float64(1.0) / wp.float64(wanted[b])
                load = wp.lerp(at.grip.loads[b, f, q], load, share)
                held = wp.lerp(at.grip.held[b, f, q], held, share)
            at.grip.held[b, f, q] = held
            at.grip.anchors[b, f, q] = anchor
            at.grip.loads[b, f, q] = load
            density, pull, _tangent = held_back(at, here, b, f, q, x, _EXACT)
            energy[b, f, q] += at.surface.areas[f, q] * (density - before)
            add_traction(at.surface, b, f, q, pull - pulled, nodes)

    @wp.kernel(enable_backward=False, module=module)
    def drag(
        at: Pressed,
        # Data in:
        wanted: wp.array(dtype=wp.int32),
    ):
        b, f, q = wp.tid()
        if wanted[b] == 1:
            # An anchor is brought up to the offset behind its point, the slip length at most; that
            # of a free point comes along, to know where it was last free.
            here, x = met(at, b, f, q)
            place = local_point(here, x)
            held = at.grip.held[b, f, q]
            if held == wp.float64(0.0):
                at.grip.anchors[b, f, q] = place
            else:
                u = grip_offset(here, held, at.grip.loads[b, f, q], at.grip.anchors[b, f, q], x)
                length = wp.length(u)
                slides = length > at.surface.slip and not at.surface.bonded
                if slides:
                    u = u * (at.surface.slip / length)
                if slides or held < wp.float64(1.0):
                    at.grip.anchors[b, f, q] = place - wp.transpose(here.rotation) * u
                    at.grip.held[b, f, q] = wp.float64(1.0)

    return ContactKernels(touch, force, hold, drag)


@cache
def batch_contact_kernels(*, grips: bool) -> BatchKernels:
    """Build the kernels that only batches need."""
    contact_at = _contact_at(grips=grips)

    @wp.kernel(enable_backward=False, module="unique")
    def stiffen(
        at: Pressed,
        numbers: wp.array2d(dtype=wp.int32),
        # Data in:
        wanted: wp.array(dtype=wp.int32),
        gaps: wp.array2d(dtype=wp.float64),
        # Data out:
        stiffness_out: wp.array3d(dtype=wp.mat33f),
        touching_out: wp.array2d(dtype=wp.int32),
    ):
        # ``numbers`` are those of the faces' nodes among the surface's, -1 for what is fixed;
        # ``gaps`` those of all points where they are.
        b, f, q = wp.tid()
        if wanted[b] == 1:
            touches = gaps[b, f * at.surface.areas.shape[1] + q] < at.surface.distance
            if wp.static(grips):
                touches = touches or at.grip.held[b, f, q] > wp.float64(0.0)
            stiffness = wp.mat33d()
            if touches:
                _x, _gap, _density, _normal, _along, found = contact_at(at, b, f, q, _LEAST_ALONG)
                stiffness = found
            stiffness_out[b, f, q] = wp.mat33f(stiffness * at.surface.areas[f, q])
            if wp.trace(stiffness) > wp.float64(0.0):
                for k in range(at.surface.faces.shape[1]):
                    if numbers[f, k] >= 0:
                        touching_out[b, numbers[f, k]] = 1

    @wp.kernel(enable_backward=False, module="unique", launch_bounds=WRENCH_THREADS)
    def wrench(
        at: Pressed,
        parts: wp.int32,
        # Data in:
        wanted: wp.array(dtype=wp.int32),
        form: wp.array2d(dtype=wp.float64),
        shares: wp.array(dtype=wp.float64),
        others: wp.array3d(dtype=wp.float64),
        rest: wp.array(dtype=wp.vec3d),
        reach: wp.float64,
        gaps: wp.array3d(dtype=wp.float64),
        # Data out:
        wrench_out: wp.array2d(dtype=wp.float64),
    ):
        # So many threads in turn have a point, and share its ``others`` and its face's points. Of
        # what is farther off than ``reach`` by the last ``gaps`` no point of the face touches.
        b, thread = wp.tid()
        if wanted[b] == 1:
            sums = _WrenchSums()
            far = wp.vec4d(-FAR_M, -FAR_M, -FAR_M, -FAR_M)
            points = at.surface.areas.shape[1]
            for i in range(thread, at.surface.areas.shape[0] * points * parts, wp.block_dim()):
                part = i % parts
                own = i // parts % points
                f = i // (parts * points)
                gap = gaps[b, f, own]
                near = gap < reach
                if wp.static(grips):
                    near = near or at.grip.held[b, f, own] > wp.float64(0.0)
                if not near:
                    continue
                here, x = met(at, b, f, own)
                touched = wp.float64(0.0)
                for r in range(part, others.shape[1], parts):
                    there = wp.vec3d()
                    for k in range(others.shape[2]):
                        there += at.positions[b, at.surface.faces[f, k]] * others[own, r, k]
                    beside, _n = nearby_gap(here, there, at.surface.distance)
                    into = (at.surface.distance - beside) / (_FULLY * at.surface.distance)
                    touched += wp.clamp(into, wp.float64(0.0), wp.float64(1.0))
                area = at.surface.areas[f, own]
                sums[6] += area * touched / wp.float64(others.shape[1])
                _density, slope, _change = normal_contact(at.surface, b, gap)
                formed = wp.float64(0.0)
                if gap < at.surface.distance:
                    for k in range(part, points, parts):
                        _density, pressed, _change = normal_contact(at.surface, b, gaps[b, f, k])
                        formed += form[own, k] * pressed * slope
                if part == 0:
                    around, n = nearby_gap(here, x, reach)
                    along = wp.vec3d()
                    if wp.static(grips):
                        _more, along, _tangent = held_back(at, here, b, f, own, x, _EXACT)
                    formed += wp.dot(along, along)
                    v = (n * slope + along) * area
                    moment = wp.cross(x - at.poses.tips[b], v)
                    for k in range(3):
                        sums[k] += v[k]
                        sums[3 + k] += moment[k]
                    z = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
                    sums[8] -= slope * (wp.float64(1.0) + wp.dot(n, here.rotation * z)) * area
                    if around < reach:
                        before = -at.poses.tips[b]
                        for k in range(others.shape[2]):
                            before += rest[at.surface.faces[f, k]] * at.surface.values[own, k]
                        far = wp.max(far, wp.vec4d(before[0], -before[0], before[1], -before[1]))
                sums[7] += formed * area * shares[f]
            all_sums = wp.tile_sum(wp.tile(sums, preserve_type=True))
            all_far = wp.tile_reduce(wp.max, wp.tile(far, preserve_type=True))
            total, farthest = all_sums[0], all_far[0]
            for k in range(thread, 13, wp.block_dim()):
                wrench_out[b, k] = total[k] if k < 9 else farthest[k - 9]

    @wp.kernel(enable_backward=False, module="unique")
    def spread(
        at: Pressed,
        hats: wp.array2d(dtype=wp.float64),
        # Data out:
        pressed_out: wp.array2d(dtype=wp.float64),
        sheared_out: wp.array2d(dtype=wp.vec3d),
    ):
        b, f, q = wp.tid()
        _x, distance, _density, normal, along, _stiffness = contact_at(at, b, f, q, _EXACT)
        if distance < at.surface.distance:
            for k in range(at.surface.faces.shape[1]):
                share = hats[q, k] * at.surface.areas[f, q]
                if share > wp.float64(0.0):
                    pressed = repeatable(wp.length(normal) * share, at.surface.shift)
                    wp.atomic_add(pressed_out, b, at.surface.faces[f, k], pressed)
                    sheared = repeatable(-along * share, at.surface.shift)
                    wp.atomic_add(sheared_out, b, at.surface.faces[f, k], sheared)

    return BatchKernels(stiffen, wrench, spread)
