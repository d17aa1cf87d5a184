"""The way that a batch's pilot went, and where on it an environment is.

The way leads in straight lines from the untouched gel to one place after the other, and may branch.
"""

from __future__ import annotations

import warp as wp

# A length that is none; it keeps quotients finite.
_NOTHING = wp.constant(wp.float64(1e-300))
# Two steps go the same way if the cosine between them is at least this.
SAME_WAY = wp.constant(wp.float64(0.9))
# Farther than any way [m].
_FAR = wp.constant(wp.float64(1e3))


@wp.struct
class Guide:
    """Where the pilot came by, the untouched gel first, shape [place_count + 1, ...].

    Attributes:
        stands: Where on the course, every component in metres.
        motions: Of the nodes from the untouched gel [m], shape [..., node_count].
        depths: Of the indenter [m].
        states: The one that is kept there, or -1.
        before: Place that the way comes from; none for the first.
        frames: Of the kept states, their numbers among those of the course, shape [state_count].
    """

    stands: wp.array(dtype=wp.vec4d)
    motions: wp.array2d(dtype=wp.vec3d)
    depths: wp.array(dtype=wp.float64)
    states: wp.array(dtype=wp.int32)
    before: wp.array(dtype=wp.int32)
    frames: wp.array(dtype=wp.int32)


@wp.struct
class Stand:
    """A point of the pilot's way: a share of the way to a place from the one before it.

    Attributes:
        place: Where it leads, at least 1.
        share: Of the way.
    """

    place: wp.int32
    share: wp.float64


@wp.func
def stands_of(guide: Guide, before: wp.vec4d, after: wp.vec4d):
    """Return the points of the pilot's way that are nearest to where a step begins and ends.

    They are where the pilot went in the step's direction; where it never did, both are the first.

    Returns:
        The two, and the kept state nearest to the end.
    """
    began = Stand()
    ends = Stand()
    began.place = 1
    ends.place = 1
    nearest = wp.int32(0)
    step = after - before
    least = wp.vec3d(wp.float64(1e300), wp.float64(1e300), wp.float64(1e300))
    for k in range(1, guide.stands.shape[0]):
        start = guide.stands[guide.before[k]]
        along = guide.stands[k] - start
        square = wp.max(wp.dot(along, along), _NOTHING)
        is_along = wp.dot(along, step) >= SAME_WAY * wp.sqrt(square) * wp.length(step)
        first = wp.clamp(wp.dot(before - start, along) / square, wp.float64(0.0), wp.float64(1.0))
        last = wp.clamp(wp.dot(after - start, along) / square, wp.float64(0.0), wp.float64(1.0))
        apart = wp.vec3d(
            wp.length(start + along * first - before),
            wp.length(start + along * last - after),
            wp.length(start + along - after),
        )
        if not is_along:
            apart[2] += _FAR
        if is_along and apart[0] < least[0]:
            least[0] = apart[0]
            began.place = k
            began.share = first
        if is_along and apart[1] < least[1]:
            least[1] = apart[1]
            ends.place = k
            ends.share = last
        if guide.states[k] >= 0 and apart[2] < least[2]:
            least[2] = apart[2]
            nearest = guide.states[k]
    return began, ends, nearest


@wp.func
def place_of(guide: Guide, stand: Stand) -> wp.vec4d:
    """Return where on the course a point is, every component in metres."""
    before = guide.stands[guide.before[stand.place]]
    return before + (guide.stands[stand.place] - before) * stand.share


@wp.func
def motion_at(guide: Guide, stand: Stand, n: wp.int32) -> wp.vec3d:
    """Return how far a node of the pilot has gone [m]."""
    before = guide.motions[guide.before[stand.place], n]
    return before + (guide.motions[stand.place, n] - before) * stand.share


@wp.func
def depth_at(guide: Guide, stand: Stand) -> wp.float64:
    """Return how deep the pilot's indenter is [m]."""
    before = guide.depths[guide.before[stand.place]]
    return before + (guide.depths[stand.place] - before) * stand.share
