"""The path of a batch's pilot, and where on it an environment is.

The path leads in straight lines from the untouched gel to one point after the other, and may
branch.
"""

from __future__ import annotations

import warp as wp

# A length that is none; it keeps quotients finite.
_NOTHING = wp.constant(wp.float64(1e-300))
# Two steps go in the same direction if the cosine between them is at least this.
SAME_DIRECTION = wp.constant(wp.float64(0.9))
# Farther than any path [m].
_FAR = wp.constant(wp.float64(1e3))


@wp.struct
class PilotPath:
    """The points of the pilot's path, the untouched gel first, shape [point_count + 1, ...]."""

    coordinates: wp.array(dtype=wp.vec4d)  # along x and y, depth or load, turn; each in metres
    # of the nodes from the untouched gel [m], shape [..., node_count]
    motions: wp.array2d(dtype=wp.vec3d)
    depths: wp.array(dtype=wp.float64)  # of the indenter [m]
    states: wp.array(dtype=wp.int32)  # the one that is kept there, or -1
    before: wp.array(dtype=wp.int32)  # point that the path comes from
    # of the kept states, their numbers among the trajectory's, shape [state_count]
    frames: wp.array(dtype=wp.int32)


@wp.struct
class PathPosition:
    """A position on the pilot's path: a share of the segment to a point from the one before it."""

    point: wp.int32  # where the segment leads, at least 1
    share: wp.float64  # of the segment


@wp.func
def path_positions(path: PilotPath, before: wp.vec4d, after: wp.vec4d):
    """Return the positions on the pilot's path that are nearest to where a step begins and ends.

    They are where the pilot went in the step's direction; where it never did, both are the first.

    Returns:
        The two, and the kept state nearest to the end.
    """
    began = PathPosition()
    ends = PathPosition()
    began.point = 1
    ends.point = 1
    nearest = wp.int32(0)
    step = after - before
    least = wp.vec3d(wp.float64(1e300), wp.float64(1e300), wp.float64(1e300))
    for k in range(1, path.coordinates.shape[0]):
        start = path.coordinates[path.before[k]]
        along = path.coordinates[k] - start
        square = wp.max(wp.dot(along, along), _NOTHING)
        is_along = wp.dot(along, step) >= SAME_DIRECTION * wp.sqrt(square) * wp.length(step)
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
            began.point = k
            began.share = first
        if is_along and apart[1] < least[1]:
            least[1] = apart[1]
            ends.point = k
            ends.share = last
        if path.states[k] >= 0 and apart[2] < least[2]:
            least[2] = apart[2]
            nearest = path.states[k]
    return began, ends, nearest


@wp.func
def coordinates_at(path: PilotPath, position: PathPosition) -> wp.vec4d:
    """Return the coordinates of a position, every component in metres."""
    before = path.coordinates[path.before[position.point]]
    return before + (path.coordinates[position.point] - before) * position.share


@wp.func
def motion_at(path: PilotPath, position: PathPosition, n: wp.int32) -> wp.vec3d:
    """Return how far a node of the pilot has gone [m]."""
    before = path.motions[path.before[position.point], n]
    return before + (path.motions[position.point, n] - before) * position.share


@wp.func
def depth_at(path: PilotPath, position: PathPosition) -> wp.float64:
    """Return how deep the pilot's indenter is [m]."""
    before = path.depths[path.before[position.point]]
    return before + (path.depths[position.point] - before) * position.share
