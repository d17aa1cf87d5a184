"""The way that a batch's pilot went, and where on it an environment is.

The way leads in straight lines from the untouched gel to one kept state after the other.
"""

from __future__ import annotations

import warp as wp

# A length that is none; it keeps quotients finite.
_NOTHING = wp.constant(wp.float64(1e-300))


@wp.struct
class Guide:
    """What the pilot did, the untouched gel first, shape [state_count + 1, ...] each.

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
    """A place on the pilot's way: a share of the way from one state to the next.

    Attributes:
        state: The former, 0 for the untouched gel.
        share: Of the way.
        beside: How far the way is [m].
        nearest: The pilot's state that is nearest, 0 for the first that is kept.
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
    for k in range(guide.stands.shape[0] - 1):
        before = guide.stands[k]
        stand = guide.stands[k + 1]
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
    return found


@wp.func
def motion_at(guide: Guide, stand: Stand, n: wp.int32) -> wp.vec3d:
    """Return how far a node of the pilot has gone [m]."""
    before = guide.motions[stand.state, n]
    return before + (guide.motions[stand.state + 1, n] - before) * stand.share


@wp.func
def depth_at(guide: Guide, stand: Stand) -> wp.float64:
    """Return how deep the pilot's indenter is [m]."""
    before = guide.depths[stand.state]
    return before + (guide.depths[stand.state + 1] - before) * stand.share
