"""Warp kernels from a model's nodes to the nodes and slopes that a height map is drawn from.

Every kernel's first index is the environment. A part is a face, or one of the sixteen of a steep
face; which of them there are, ``steep`` says.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from sim.optics.height.underside_kernel import Poses, underside
from sim.scene.triangle_rays import BESIDE

_SIXTEEN = wp.constant(16)
_STEEP_SLOPE = wp.constant(wp.float64(0.5))
# Of a face's area over twice that of its parameters [m^2]: less has no slope.
_FLAT_M2 = wp.constant(wp.float64(1.0e-18))
_SLOPE_STEP_M = wp.constant(wp.float64(1.0e-6))
TOUCHES, COVERED, SMOOTH = wp.constant(1), wp.constant(2), wp.constant(4)
FREE, AT_RIM = wp.constant(0), wp.constant(1)


@wp.struct
class Follower:
    """How the drawn nodes follow a model's, and which of them make faces and parts.

    Attributes:
        sources: Node of the model that each drawn one is, or mirrors, shape [node_count].
        signs: Of its coordinates.
        lifts: By what the pad's top lies higher at rest [m].
        faces: Nodes of each face, shape [face_count, 6 or 3].
        parts: Nodes of the faces, then of the sixteen parts of each, the same width.
        facets: Corners of a part's linear facets among its nodes, shape [4 or 1, 3].
    """

    sources: wp.array(dtype=wp.int32)
    signs: wp.array(dtype=wp.vec3d)
    lifts: wp.array(dtype=wp.float64)
    faces: wp.array2d(dtype=wp.int32)
    parts: wp.array2d(dtype=wp.int32)
    facets: wp.array2d(dtype=wp.int32)


@wp.struct
class Rings:
    """``rings.RoundRings`` on a device, and the axis [m]."""

    x: wp.float64
    y: wp.float64
    angle: wp.array(dtype=wp.float64)
    between: wp.array(dtype=wp.int32)
    on_rays: wp.array(dtype=wp.int32)
    starts: wp.array(dtype=wp.int32)
    weight_starts: wp.array(dtype=wp.int32)
    counts: wp.array(dtype=wp.int32)
    weights: wp.array(dtype=wp.float64)


@wp.struct
class Cuts:
    """``steep_faces.CutFace`` and ``AddedNodes`` on a device."""

    values: wp.array2d(dtype=wp.float64)
    straight: wp.array2d(dtype=wp.float64)
    across: wp.array2d(dtype=wp.int32)
    face: wp.array(dtype=wp.int32)
    beside: wp.array(dtype=wp.int32)
    place: wp.array(dtype=wp.int32)


@wp.kernel(enable_backward=False)
def take_nodes(
    follower: Follower,
    # Data in:
    positions: wp.array2d(dtype=wp.vec3d),
    # Data out:
    node_out: wp.array2d(dtype=wp.vec3d),
):
    """Mirror and lift a model's nodes."""
    env, i = wp.tid()
    x = wp.cw_mul(positions[env, follower.sources[i]], follower.signs[i])
    node_out[env, i] = x + wp.vec3d(wp.float64(0.0), wp.float64(0.0), follower.lifts[i])


@wp.kernel(enable_backward=False)
def place_on_rings(
    rings: Rings,
    # Data in:
    nodes: wp.array2d(dtype=wp.vec3d),
    # Data out:
    place_out: wp.array2d(dtype=wp.vec3d),
):
    """Find radius, turn and height of the nodes between rays."""
    env, i = wp.tid()
    node = rings.between[i]
    x = nodes[env, node]
    dx, dy = x[0] - rings.x, x[1] - rings.y
    turned = wp.atan2(dy, dx) - rings.angle[node]
    whole = wp.float64(2.0 * wp.pi)
    turned = turned - whole * wp.floor((turned + wp.float64(wp.pi)) / whole)
    place_out[env, i] = wp.vec3d(wp.sqrt(dx * dx + dy * dy), turned, x[2])


@wp.kernel(enable_backward=False)
def round_nodes(
    rings: Rings,
    # Data in:
    places: wp.array2d(dtype=wp.vec3d),
    # Data in and out:
    nodes: wp.array2d(dtype=wp.vec3d),
):
    """Put the nodes on rays onto the curves through those between."""
    env, i = wp.tid()
    place = wp.vec3d()
    for k in range(rings.counts[i]):
        place += rings.weights[rings.weight_starts[i] + k] * places[env, rings.starts[i] + k]
    node = rings.on_rays[i]
    angle = rings.angle[node] + place[1]
    x = rings.x + place[0] * wp.cos(angle)
    nodes[env, node] = wp.vec3d(x, rings.y + place[0] * wp.sin(angle), place[2])


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
def _tangents(
    nodes: wp.array2d(dtype=wp.vec3d),
    faces: wp.array2d(dtype=wp.int32),
    env: int,
    f: int,
    k: int,
):
    """Return the derivatives of a quadratic face along its edges 01 and 02, at its node ``k``."""
    at = _face_node(k)
    one, four = wp.float64(1.0), wp.float64(4.0)
    first = (one - four * at[0]) * nodes[env, faces[f, 0]]
    b, c = nodes[env, faces[f, 1]], nodes[env, faces[f, 2]]
    ab, bc, ca = nodes[env, faces[f, 3]], nodes[env, faces[f, 4]], nodes[env, faces[f, 5]]
    along = first + (four * at[1] - one) * b + four * (at[0] - at[1]) * ab
    along += four * at[2] * (bc - ca)
    across = first + (four * at[2] - one) * c + four * (at[0] - at[2]) * ca
    across += four * at[1] * (bc - ab)
    return along, across


@wp.kernel(enable_backward=False)
def mark_steep(
    follower: Follower,
    # Data in:
    nodes: wp.array2d(dtype=wp.vec3d),
    # Data out:
    steep_out: wp.array2d(dtype=wp.int32),
):
    """Mark the faces that are somewhere steeper than a limit, or hang over."""
    env, f = wp.tid()
    steep = 0
    for k in range(6):
        along, across = _tangents(nodes, follower.faces, env, f, k)
        normal = wp.cross(along, across)
        if wp.sqrt(normal[0] * normal[0] + normal[1] * normal[1]) > _STEEP_SLOPE * normal[2]:
            steep = 1
    steep_out[env, f] = steep


@wp.func
def _is_added(cuts: Cuts, steep: wp.array2d(dtype=wp.int32), env: int, i: int):
    """Return whether one of the faces of a node that cutting adds is cut."""
    cut = steep[env, cuts.face[i]] == 1
    if not cut and cuts.beside[i] >= 0:
        cut = steep[env, cuts.beside[i]] == 1
    return cut


@wp.kernel(enable_backward=False)
def add_nodes(
    follower: Follower,
    cuts: Cuts,
    # Data in:
    steep: wp.array2d(dtype=wp.int32),
    # Data in and out:
    nodes: wp.array2d(dtype=wp.vec3d),
):
    """Put nodes where steep faces are cut, see ``steep_faces``."""
    env, i = wp.tid()
    if not _is_added(cuts, steep, env, i):
        return
    f, place = cuts.face[i], cuts.place[i]
    x = wp.vec3d()
    for k in range(6):
        x += cuts.values[place, k] * nodes[env, follower.faces[f, k]]
    for edge in range(3):
        across = cuts.across[f, edge]
        both = 0
        if across >= 0:
            both = steep[env, f] * steep[env, across]
        if both == 0:
            ends = nodes[env, follower.faces[f, edge]]
            ends += nodes[env, follower.faces[f, (edge + 1) % 3]]
            bend = ends - wp.float64(2.0) * nodes[env, follower.faces[f, 3 + edge]]
            by = wp.float64(0.125) * cuts.straight[place, edge]
            x += by * wp.vec3d(bend[0], bend[1], wp.float64(0.0))
    nodes[env, follower.sources.shape[0] + i] = x


@wp.kernel(enable_backward=False, module="unique")
def close_gaps(
    follower: Follower,
    cuts: Cuts,
    body: Any,
    poses: Poses,
    gap_m: wp.float64,
    # Data in:
    steep: wp.array2d(dtype=wp.int32),
    # Data in and out:
    nodes: wp.array2d(dtype=wp.vec3d),
    # Data out:
    slope_out: wp.array2d(dtype=wp.vec2d),
    state_out: wp.array2d(dtype=wp.int32),
):
    """Lift nodes that touch onto the indenter; say which do, and its slope there."""
    env, i = wp.tid()
    added = i - follower.sources.shape[0]
    if added >= 0 and not _is_added(cuts, steep, env, added):
        return
    x = nodes[env, i]
    step = _SLOPE_STEP_M
    state = 0
    ceiling = underside(body, poses, env, x[0], x[1])
    if ceiling < BESIDE:
        state = COVERED
    right = underside(body, poses, env, x[0] + step, x[1])
    left = underside(body, poses, env, x[0] - step, x[1])
    ahead = underside(body, poses, env, x[0], x[1] + step)
    behind = underside(body, poses, env, x[0], x[1] - step)
    slope = wp.vec2d()
    if wp.max(wp.max(right, left), wp.max(ahead, behind)) < BESIDE:
        slope = wp.vec2d(right - left, ahead - behind) / (wp.float64(2.0) * step)
        state |= SMOOTH
    if ceiling - x[2] <= gap_m * wp.sqrt(wp.float64(1.0) + wp.dot(slope, slope)):
        state |= TOUCHES
        nodes[env, i] = wp.vec3d(x[0], x[1], ceiling)
    slope_out[env, i] = slope
    state_out[env, i] = state


@wp.func
def is_part(steep: wp.array2d(dtype=wp.int32), env: int, part: int):
    """Return whether a part is drawn: a face that is not steep, or a part of one that is."""
    faces = steep.shape[1]
    if part < faces:
        return steep[env, part] == 0
    return steep[env, (part - faces) / _SIXTEEN] == 1


@wp.func
def touching_count(follower: Follower, states: wp.array2d(dtype=wp.int32), env: int, part: int):
    """Return how many nodes of a part touch."""
    count = wp.int32(0)
    for k in range(follower.parts.shape[1]):
        if states[env, follower.parts[part, k]] & TOUCHES:
            count += 1
    return count


@wp.kernel(enable_backward=False)
def mark_edges(
    follower: Follower,
    # Data in:
    steep: wp.array2d(dtype=wp.int32),
    states: wp.array2d(dtype=wp.int32),
    # Data out:
    mark_out: wp.array3d(dtype=wp.int32),
):
    """Mark nodes of parts that do not touch with all of theirs, and of facets not all covered."""
    env, part = wp.tid()
    if not is_part(steep, env, part):
        return
    width = follower.parts.shape[1]
    if touching_count(follower, states, env, part) < width:
        for k in range(width):
            mark_out[env, follower.parts[part, k], FREE] = 1
    for facet in range(follower.facets.shape[0]):
        covered = COVERED
        for c in range(3):
            covered &= states[env, follower.parts[part, follower.facets[facet, c]]]
        if covered == 0:
            for c in range(3):
                mark_out[env, follower.parts[part, follower.facets[facet, c]], AT_RIM] = 1


@wp.kernel(enable_backward=False)
def add_slopes(
    follower: Follower,
    # Data in:
    steep: wp.array2d(dtype=wp.int32),
    states: wp.array2d(dtype=wp.int32),
    marks: wp.array3d(dtype=wp.int32),
    nodes: wp.array2d(dtype=wp.vec3d),
    # Data in and out:
    sums: wp.array2d(dtype=wp.vec3d),
):
    """Add the slopes of quadratic parts at their nodes, weighted by areas, and the weights.

    Parts that touch with all their nodes do not count at the edge of the contact.
    """
    env, part = wp.tid()
    if not is_part(steep, env, part):
        return
    pressed = touching_count(follower, states, env, part) == 6
    for k in range(6):
        node = follower.parts[part, k]
        if pressed and marks[env, node, FREE] == 1:
            continue
        s, t = _tangents(nodes, follower.parts, env, part, k)
        area = s[0] * t[1] - s[1] * t[0]
        weighed = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.abs(area))
        if wp.abs(area) > _FLAT_M2:
            turn = wp.sign(area)
            weighed[0] = turn * (t[1] * s[2] - s[1] * t[2])
            weighed[1] = turn * (s[0] * t[2] - t[0] * s[2])
        wp.atomic_add(sums, env, node, weighed)
