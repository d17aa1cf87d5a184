"""Warp kernels from a model's nodes to the nodes and slopes that a height map is drawn from.

Every kernel's first index is the environment. A part is a face, or one of the sixteen of a steep
face; which of them there are, ``steep`` says.
"""

import warp as wp

from sim.contact.indenter_distance import Body, Poses, posed
from sim.scene.triangle_distance import BESIDE, lowest_height

_TILT_ITERATIONS = wp.constant(40)
_SETTLED_M = wp.constant(wp.float64(1.0e-12))


@wp.func
def _lowest(body: Body, x: wp.float64, y: wp.float64) -> wp.float64:
    """Return the height over a point in the indenter's frame, ``BESIDE`` beside the body."""
    if body.is_mesh:
        return lowest_height(body.surface, x, y)
    zero = wp.float64(0.0)
    away = x * x + y * y
    radius = wp.sqrt(away)
    inside = wp.clamp(radius - (body.radius - body.fillet), zero, body.fillet)
    squared = wp.where(body.is_ball, away, inside * inside)  # the root costs a ball digits
    arc = wp.sqrt(wp.max(body.fillet * body.fillet - squared, zero))
    return wp.where(radius > body.radius, BESIDE, body.fillet - arc)


@wp.func
def underside(
    bodies: wp.array(dtype=Body),
    poses: Poses,
    away_m: wp.float64,
    env: int,
    x: wp.float64,
    y: wp.float64,
):
    """Return the height of an environment's indenter over the pad [m], ``BESIDE`` beside it.

    The body is larger than the indenter by ``away_m``, and its tip lies lower by as much.

    A tilted indenter is solved for by fixed-point iteration along z, which contracts while tilt
    times slope stays below one; the flanks of a tilted cylinder do not count as underside.
    """
    here = posed(bodies, poses, env)
    R = poses.rotations[env]
    tip = poses.tips[env]
    dx = x - (tip[0] - away_m * R[0, 2])
    dy = y - (tip[1] - away_m * R[1, 2])
    lateral = R[0, 2] * dx + R[1, 2] * dy
    upright = wp.abs(R[0, 2]) + wp.abs(R[1, 2]) < _SETTLED_M
    height = wp.float64(0.0)
    beside = bool(False)  # noqa: UP018 - a variable to Warp, not a constant
    for _ in range(_TILT_ITERATIONS):
        at_x = R[0, 0] * dx + R[1, 0] * dy + R[2, 0] * height
        at_y = R[0, 1] * dx + R[1, 1] * dy + R[2, 1] * height
        lowest = _lowest(here, at_x, at_y)
        beside = lowest >= BESIDE
        found = (wp.where(beside, wp.float64(0.0), lowest) - lateral) / R[2, 2]
        settled = wp.abs(found - height) < _SETTLED_M
        height = found
        if upright or settled:
            break
    return wp.where(beside, BESIDE, height + tip[2] - away_m * R[2, 2])


_SIXTEEN = wp.constant(16)
_STEEP_SLOPE = wp.constant(wp.float64(0.5))
# Of a face's area over twice that of its parameters [m^2]: less has no slope.
_FLAT_M2 = wp.constant(wp.float64(1.0e-18))
_SLOPE_STEP_M = wp.constant(wp.float64(1.0e-6))
# Of a node that touches the indenter, at its rim and elsewhere; zero is one that does not.
AT_RIM, FOLLOWS = wp.constant(1), wp.constant(2)


@wp.struct
class Gel:
    """How the drawn nodes follow a model's, and which of them make faces and parts.

    What a mesh does not call for is empty: steep faces that are cut (``height_map``), rings that
    are drawn round.
    """

    sources: wp.array(dtype=wp.int32)  # node of the model that each is, or mirrors, [node_count]
    signs: wp.array(dtype=wp.vec3d)  # of its coordinates
    lifts: wp.array(dtype=wp.float64)  # by what the pad's top lies higher at rest [m]
    faces: wp.array2d(dtype=wp.int32)  # nodes of each face, shape [face_count, 6 or 3]
    parts: wp.array2d(dtype=wp.int32)  # nodes of the faces, then of the sixteen parts of each
    facets: wp.array2d(dtype=wp.int32)  # corners of a part's among its nodes, shape [4 or 1, 3]
    standoff: wp.float64  # by how much what bounds the gel is larger than the indenter [m]
    gap: wp.float64  # largest gap between gel and what bounds it that counts as touching [m]
    # Shape functions of a face at the places of a cut one, shape [place_count, 6]
    values: wp.array2d(dtype=wp.float64)
    # how far a place moves, seen from above, with the bend of each edge drawn straight
    straight: wp.array2d(dtype=wp.float64)
    across: wp.array2d(dtype=wp.int32)  # face over each edge, -1 is none, shape [face_count, 3]
    face: wp.array(dtype=wp.int32)  # a face of each node that cutting adds
    beside: wp.array(dtype=wp.int32)  # the other one of a node on an edge, -1 where there is none
    place: wp.array(dtype=wp.int32)  # which place of ``face`` it is
    axis: wp.vec2d  # of the rings, x and y [m]
    angle: wp.array(dtype=wp.float64)  # about the axis at rest of the nodes [rad]
    between: wp.array2d(dtype=wp.int32)  # nodes amid chords, shape [ring_count, sector_count]
    on_rays: wp.array2d(dtype=wp.int32)  # nodes at the ends of chords, the same shape
    # Of radius, turn and height of those in the middle in theirs, shape [ring_count, sector_count,
    # sector_count]
    weights: wp.array3d(dtype=wp.float64)


@wp.struct
class Canvas:
    """What is drawn; the first index is the environment."""

    nodes: wp.array2d(dtype=wp.vec3d)  # the model's and those that cutting adds [m]
    slopes: wp.array2d(dtype=wp.vec2d)  # of the indenter at the nodes
    sums: wp.array2d(dtype=wp.vec3d)  # slope of the gel at the nodes times a weight, and the weight
    states: wp.array2d(dtype=wp.int32)  # of the nodes, see ``AT_RIM``
    steep: wp.array2d(dtype=wp.int32)  # 1 for a face that is cut
    heights: wp.array2d(dtype=wp.float64)  # by pixel [m]
    pressed: wp.array2d(dtype=wp.uint8)  # 1 for pixels of a facet whose corners all touch
    rest: wp.array(dtype=wp.float64)  # height of the unloaded surface by pixel [m], of all


@wp.kernel(enable_backward=False)
def take_nodes(gel: Gel, positions: wp.array2d(dtype=wp.vec3d), canvas: Canvas):
    """Mirror and lift a model's nodes."""
    env, i = wp.tid()
    x = wp.cw_mul(positions[env, gel.sources[i]], gel.signs[i])
    canvas.nodes[env, i] = x + wp.vec3d(wp.float64(0.0), wp.float64(0.0), gel.lifts[i])


@wp.func
def _ring_place(gel: Gel, canvas: Canvas, env: int, node: int):
    """Return radius about the axis, turn since rest and height of a node."""
    x = canvas.nodes[env, node]
    dx, dy = x[0] - gel.axis[0], x[1] - gel.axis[1]
    turned = wp.atan2(dy, dx) - gel.angle[node]
    whole = wp.float64(2.0 * wp.pi)
    turned = turned - whole * wp.floor((turned + wp.float64(wp.pi)) / whole)
    return wp.vec3d(wp.sqrt(dx * dx + dy * dy), turned, x[2])


@wp.kernel(enable_backward=False)
def round_nodes(gel: Gel, canvas: Canvas):
    """Put the nodes on rays onto the curves through those between."""
    env, ring, i = wp.tid()
    place = wp.vec3d()
    for k in range(gel.between.shape[1]):
        between = _ring_place(gel, canvas, env, gel.between[ring, k])
        place += gel.weights[ring, i, k] * between
    node = gel.on_rays[ring, i]
    angle = gel.angle[node] + place[1]
    x = gel.axis[0] + place[0] * wp.cos(angle)
    canvas.nodes[env, node] = wp.vec3d(x, gel.axis[1] + place[0] * wp.sin(angle), place[2])


@wp.func
def _face_node(k: int):
    """Return the barycentric coordinates of a quadratic face's node."""
    place = wp.vec3d()
    for c in range(3):
        if k == c:
            place[c] = wp.float64(1.0)
        if k == c + 3 or k == (c + 2) % 3 + 3:
            place[c] = wp.float64(0.5)
    return place


@wp.func
def _tangents(canvas: Canvas, faces: wp.array2d(dtype=wp.int32), env: int, f: int, k: int):
    """Return the derivatives of a face along its edges 01 and 02, at its node ``k``."""
    nodes = canvas.nodes
    a, b, c = nodes[env, faces[f, 0]], nodes[env, faces[f, 1]], nodes[env, faces[f, 2]]
    along, across = b - a, c - a
    if faces.shape[1] == 6:
        at = _face_node(k)
        one, four = wp.float64(1.0), wp.float64(4.0)
        first = (one - four * at[0]) * a
        ab, bc, ca = nodes[env, faces[f, 3]], nodes[env, faces[f, 4]], nodes[env, faces[f, 5]]
        along = first + (four * at[1] - one) * b + four * (at[0] - at[1]) * ab
        along += four * at[2] * (bc - ca)
        across = first + (four * at[2] - one) * c + four * (at[0] - at[2]) * ca
        across += four * at[1] * (bc - ab)
    return along, across


@wp.kernel(enable_backward=False)
def mark_steep(gel: Gel, canvas: Canvas):
    """Mark the faces that are somewhere steeper than a limit, or hang over."""
    env, f = wp.tid()
    steep = 0
    for k in range(6):
        along, across = _tangents(canvas, gel.faces, env, f, k)
        normal = wp.cross(along, across)
        if wp.sqrt(normal[0] * normal[0] + normal[1] * normal[1]) > _STEEP_SLOPE * normal[2]:
            steep = 1
    canvas.steep[env, f] = steep


@wp.func
def _is_added(gel: Gel, canvas: Canvas, env: int, i: int):
    """Return whether one of the faces of a node that cutting adds is cut."""
    cut = canvas.steep[env, gel.face[i]] == 1
    if not cut and gel.beside[i] >= 0:
        cut = canvas.steep[env, gel.beside[i]] == 1
    return cut


@wp.kernel(enable_backward=False)
def add_nodes(gel: Gel, canvas: Canvas):
    """Put nodes where steep faces are cut, see ``height_map``."""
    env, i = wp.tid()
    if not _is_added(gel, canvas, env, i):
        return
    f, place = gel.face[i], gel.place[i]
    x = wp.vec3d()
    for k in range(6):
        x += gel.values[place, k] * canvas.nodes[env, gel.faces[f, k]]
    for edge in range(3):
        across = gel.across[f, edge]
        both = 0
        if across >= 0:
            both = canvas.steep[env, f] * canvas.steep[env, across]
        if both == 0:
            ends = canvas.nodes[env, gel.faces[f, edge]]
            ends += canvas.nodes[env, gel.faces[f, (edge + 1) % 3]]
            bend = ends - wp.float64(2.0) * canvas.nodes[env, gel.faces[f, 3 + edge]]
            by = wp.float64(0.125) * gel.straight[place, edge]
            x += by * wp.vec3d(bend[0], bend[1], wp.float64(0.0))
    canvas.nodes[env, gel.sources.shape[0] + i] = x


@wp.kernel(enable_backward=False, module="unique")
def close_gaps(gel: Gel, bodies: wp.array(dtype=Body), poses: Poses, canvas: Canvas):
    """Lift nodes that touch onto the indenter; say which do, and its slope there."""
    env, i = wp.tid()
    added = i - gel.sources.shape[0]
    if added >= 0 and not _is_added(gel, canvas, env, added):
        return
    x = canvas.nodes[env, i]
    step = _SLOPE_STEP_M
    ceiling = underside(bodies, poses, gel.standoff, env, x[0], x[1])
    right = underside(bodies, poses, gel.standoff, env, x[0] + step, x[1])
    left = underside(bodies, poses, gel.standoff, env, x[0] - step, x[1])
    ahead = underside(bodies, poses, gel.standoff, env, x[0], x[1] + step)
    behind = underside(bodies, poses, gel.standoff, env, x[0], x[1] - step)
    slope, state, touching = wp.vec2d(), wp.int32(0), AT_RIM
    if wp.max(wp.max(right, left), wp.max(ahead, behind)) < BESIDE:
        slope = wp.vec2d(right - left, ahead - behind) / (wp.float64(2.0) * step)
        touching = FOLLOWS
    if ceiling - x[2] <= gel.gap * wp.sqrt(wp.float64(1.0) + wp.dot(slope, slope)):
        state = touching
        canvas.nodes[env, i] = wp.vec3d(x[0], x[1], ceiling)
    canvas.slopes[env, i] = slope
    canvas.states[env, i] = state


@wp.func
def is_part(canvas: Canvas, env: int, part: int):
    """Return whether a part is drawn: a face that is not steep, or a part of one that is."""
    faces = canvas.steep.shape[1]
    if part < faces:
        return canvas.steep[env, part] == 0
    return canvas.steep[env, (part - faces) / _SIXTEEN] == 1


@wp.kernel(enable_backward=False)
def add_slopes(gel: Gel, canvas: Canvas):
    """Add the slopes of parts at their nodes, weighted by areas, and the weights."""
    env, part = wp.tid()
    if not is_part(canvas, env, part):
        return
    for k in range(gel.parts.shape[1]):
        s, t = _tangents(canvas, gel.parts, env, part, k)
        area = s[0] * t[1] - s[1] * t[0]
        weighed = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.abs(area))
        if wp.abs(area) > _FLAT_M2:
            turn = wp.sign(area)
            weighed[0] = turn * (t[1] * s[2] - s[1] * t[2])
            weighed[1] = turn * (s[0] * t[2] - t[0] * s[2])
        wp.atomic_add(canvas.sums, env, gel.parts[part, k], weighed)
