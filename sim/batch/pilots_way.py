"""The way that a batch's pilot went, and where on it an environment is.

The way leads in straight lines from the untouched gel to one kept state after the other.
"""

from __future__ import annotations

import warp as wp

# A length that is none; it keeps quotients finite.
_NOTHING = wp.constant(wp.float64(1e-300))


@wp.struct
class Guide:
    """What the pilot did, shape [state_count, ...] each.

    Attributes:
        stands: Where on the course, every component in metres.
        motions: Of the nodes from the untouched gel [m], shape [..., node_count].
        depths: Of the indenter [m].
    """

    stands: wp.array(dtype=wp.vec4d)
    motions: wp.array2d(dtype=wp.vec3d)
    depths: wp.array(dtype=wp.float64)


@wp.struct
class Stand:
    """A place on the pilot's way: a share of the way from the state before one to it.

    Attributes:
        state: That state.
        share: Of the way.
        beside: How far the way is [m].
        nearest: The pilot's state that is nearest.
    """

    state: wp.int32
    share: wp.float64
    beside: wp.float64
    nearest: wp.int32


@wp.func
def stand_of(guide: Guide, feature: wp.vec4d) -> Stand:
    """Return the place on the pilot's way that is nearest to a feature."""
    found = Stand()
    found.beside = wp.float64(1e300)
    best = wp.float64(1e300)
    before = wp.vec4d()
    for k in range(guide.stands.shape[0]):
        stand = guide.stands[k]
        along = stand - before
        apart = wp.length_sq(stand - feature)
        if apart < best:
            best = apart
            found.nearest = k
        share = wp.dot(feature - before, along) / wp.max(wp.dot(along, along), _NOTHING)
        share = wp.clamp(share, wp.float64(0.0), wp.float64(1.0))
        beside = wp.length(before + along * share - feature)
        if beside <= found.beside:
            found.state = k
            found.share = share
            found.beside = beside
        before = stand
    return found


@wp.func
def motion_at(guide: Guide, stand: Stand, n: wp.int32) -> wp.vec3d:
    """Return how far a node of the pilot has gone [m]."""
    there = guide.motions[stand.state, n]
    before = wp.vec3d()
    if stand.state > 0:
        before = guide.motions[stand.state - 1, n]
    return before + (there - before) * stand.share


@wp.func
def depth_at(guide: Guide, stand: Stand) -> wp.float64:
    """Return how deep the pilot's indenter is [m]."""
    there = guide.depths[stand.state]
    before = wp.float64(0.0)
    if stand.state > 0:
        before = guide.depths[stand.state - 1]
    return before + (there - before) * stand.share
