"""Warp kernels of a step of a batch: where every environment starts from, and what it found.

A step takes each environment's indenter to a pose or a load. As long as that goes the pilot's way,
it starts with the motion that the pilot made there. Beside it, it starts where the last two states
lead if the step goes the same way as the one before; else from the last one. Along a course
an environment goes on to its next frame as soon as it has arrived, unless it would need an inverse
far from those that serve the others.
"""

from __future__ import annotations

import warp as wp

from sim.batch.pilots_way import (
    SAME_WAY,
    Guide,
    Stand,
    depth_at,
    motion_at,
    place_of,
    stands_of,
)
from sim.contact.contact_kernels import GripArrays
from sim.contact.indenter_distance import Poses
from sim.solve.descent_state import Descent, Mode, Status
from sim.solve.memory_kernels import Memory, wait_for_all

# A step goes the same way as the one before if it is so many times as long at most.
_LONGER = wp.constant(wp.float64(3.0))
_NOTHING = wp.constant(wp.float64(1e-300))
# A step goes the pilot's way if it is unlike the pilot's by no more than this share of its length,
# and leads no further beside it than this share of the way from first touch.
_BESIDE = wp.constant(wp.float64(0.5))
_NEVER = wp.constant(2**30)

# Stages of an environment.
WAITS = wp.constant(0)
LANDS = wp.constant(1)  # it has just arrived
STARTS = wp.constant(2)
GOES = wp.constant(3)


@wp.struct
class Way:
    """Where the environments begin and go.

    Attributes:
        tips: Of the indenter at first touch [m], shape [environment_count].
        rotations: Indenter frame to pad frame, there.
        course: Frame by frame, shape [frame_count, environment_count]: depth [m] or force that
            pushes the whole pad [N], way along x and y [m], turn about z [rad].
        until: The frame to go to at most, shape [1].
        metres: Depth for a newton [m/N], way for a radian [m].
        copies: Of the modelled part in the whole pad.
        pushed: The force is given, and counts
        shares: as E that the pilot's gel has over their own, shape [environment_count].
        guided: 1 where the indenter comes down where the pilot's did, shape [environment_count].
        stands: Where on the pilot's way a frame begins, as ``course`` has its shape, and
        goals: where it ends.
        nearest: The kept state of the pilot that is nearest to its end.
    """

    tips: wp.array(dtype=wp.vec3d)
    rotations: wp.array(dtype=wp.mat33d)
    course: wp.array2d(dtype=wp.vec4d)
    until: wp.array(dtype=wp.int32)
    metres: wp.vec2d
    copies: wp.float64
    pushed: wp.bool
    shares: wp.array(dtype=wp.float64)
    guided: wp.array(dtype=wp.int32)
    stands: wp.array2d(dtype=Stand)
    goals: wp.array2d(dtype=Stand)
    nearest: wp.array2d(dtype=wp.int32)


@wp.struct
class Trail:
    """The last states, shape [environment_count, ...] each.

    Attributes:
        active: 1 where an environment takes part in the step.
        stage: Where it is between two frames.
        frame: Frames that it has behind it.
        share: Of the last step's way: so far the next one's start is beyond the last state.
        follows: 1 where the step goes the pilot's way.
        features: Of the last two states, newest first, shape [..., 2]: along x and y, depth or
            load, turn; each in metres.
        heights: Of the indenter's tip in them [m], shape [..., 2].
        last: Nodes of the last state [m], shape [..., node_count]; ``older`` of the one before.
    """

    active: wp.array(dtype=wp.int32)
    stage: wp.array(dtype=wp.int32)
    frame: wp.array(dtype=wp.int32)
    share: wp.array(dtype=wp.float64)
    follows: wp.array(dtype=wp.int32)
    features: wp.array2d(dtype=wp.vec4d)
    heights: wp.array2d(dtype=wp.float64)
    last: wp.array2d(dtype=wp.vec3d)
    older: wp.array2d(dtype=wp.vec3d)


@wp.struct
class Together:
    """How environments share the pilot's inverses.

    An inverse multiplies some vectors at once: those whose environments it serves lie in columns
    beside each other, in blocks of a width.

    Attributes:
        which: Inverse that serves an environment, shape [environment_count].
        rank: Of the environment among those that it serves, likewise.
        counts: Environments that an inverse serves, shape [state_count].
        first: Their first column, likewise.
        blocks: Inverse of every block of columns, -1 for none, shape [block_count].
        width: Columns of a block; 0 where every environment keeps its own column.
        ahead: Who is not the slowest needs an inverse that is so many frames after it at most.
    """

    which: wp.array(dtype=wp.int32)
    rank: wp.array(dtype=wp.int32)
    counts: wp.array(dtype=wp.int32)
    first: wp.array(dtype=wp.int32)
    blocks: wp.array(dtype=wp.int32)
    width: wp.int32
    ahead: wp.int32


@wp.struct
class Found:
    """What a step gives, shape [frame_count, environment_count] each.

    Attributes:
        push: Force on the indenter, modelled part [N].
        tips: Of the indenter [m].
        residual: Norm of the unbalanced force over the contact force.
        imbalance: Base reaction against the indenter's force, over the latter.
        gap: The smallest [m].
        status: How the descent ended.
    """

    push: wp.array2d(dtype=wp.vec3d)
    tips: wp.array2d(dtype=wp.vec3d)
    residual: wp.array2d(dtype=wp.float64)
    imbalance: wp.array2d(dtype=wp.float64)
    gap: wp.array2d(dtype=wp.float64)
    status: wp.array2d(dtype=wp.int32)


@wp.func
def feature_at(way: Way, frame: wp.int32, b: wp.int32) -> wp.vec4d:
    """Return where an environment goes in a frame, every component in metres."""
    goal = way.course[frame, b]
    along = goal[0]
    if way.pushed:
        along = along * way.metres[0] * way.shares[b]
    return wp.vec4d(goal[1], goal[2], along, goal[3] * way.metres[1])


@wp.kernel(enable_backward=False)
def lay(
    # Model:
    guide: Guide,
    # Data in:
    trail: Trail,
    # Data in and out:
    way: Way,
):
    """Find the frames' points of the pilot's way; launches as ``course`` has its shape."""
    frame, b = wp.tid()
    before = trail.features[b, 0]
    if frame > 0:
        before = feature_at(way, frame - 1, b)
    began, ends, nearest = stands_of(guide, before, feature_at(way, frame, b))
    way.stands[frame, b] = began
    way.goals[frame, b] = ends
    way.nearest[frame, b] = nearest


@wp.func
def _goes_on(way: Way, trail: Trail, b: wp.int32) -> wp.bool:
    return trail.active[b] == 1 and trail.frame[b] < way.until[0]


@wp.func
def share_out(together: Together, k: wp.int32):
    """Give an inverse columns after those of the ones before it."""
    before = wp.int32(0)
    whole = wp.int32(0)
    own = wp.int32(0)
    if together.width > 0:
        for other in range(together.counts.shape[0]):
            blocks = (together.counts[other] + together.width - 1) / together.width
            whole += blocks
            if other < k:
                before += blocks
            if other == k:
                own = blocks
    together.first[k] = before * together.width
    for block in range(before, before + own):
        together.blocks[block] = k
    for block in range(whole + k, together.blocks.shape[0], together.counts.shape[0]):
        together.blocks[block] = -1


@wp.func
def share_of(trail: Trail, b: wp.int32, goal: wp.vec4d) -> wp.float64:
    """Return the next step over the last one; zero where it leads elsewhere or much farther."""
    ahead = goal - trail.features[b, 0]
    behind = trail.features[b, 0] - trail.features[b, 1]
    step = wp.length(ahead)
    last = wp.length(behind)
    share = wp.float64(0.0)
    if step <= _LONGER * last and wp.dot(ahead, behind) > SAME_WAY * step * last:
        share = step / last
    return share


@wp.kernel(enable_backward=False)
def begin(
    # Model:
    lags: wp.bool,
    guide: Guide,
    # Data in:
    way: Way,
    together: Together,
    straight: wp.array(dtype=wp.int32),
    # Data in and out:
    trail: Trail,
    poses: Poses,
    d: Descent,
    memory: Memory,
    # Data out:
    busy_out: wp.array(dtype=wp.int32),
):
    """Let every environment begin its step that goes on; one block of threads has them all.

    Where ``straight`` is 1, from the last state as it is.
    """
    _, thread = wp.tid()
    count = trail.active.shape[0]
    # What the slowest has behind it, and the first of the frames whose inverses are needed.
    own = wp.vec2i(_NEVER, _NEVER)
    for b in range(thread, count, wp.block_dim()):
        if _goes_on(way, trail, b):
            at = trail.frame[b]
            own = wp.min(own, wp.vec2i(at, guide.frames[way.nearest[at, b]]))
    for k in range(thread, together.counts.shape[0], wp.block_dim()):
        together.counts[k] = 0
    least = wp.tile_reduce(wp.min, wp.tile(own, preserve_type=True))
    slowest = least[0]
    wait_for_all()
    for b in range(thread, count, wp.block_dim()):
        stage = trail.stage[b]
        if stage == STARTS:
            trail.stage[b] = GOES
        if stage == LANDS:
            trail.stage[b] = WAITS
        at = trail.frame[b]
        starts = stage < STARTS and _goes_on(way, trail, b)
        if starts and at > slowest[0]:
            starts = guide.frames[way.nearest[at, b]] <= slowest[1] + together.ahead
        if starts:
            trail.stage[b] = STARTS
            busy_out[0] = 1
            ahead = feature_at(way, at, b)
            share = wp.float64(0.0)
            stand = way.stands[at, b]
            goal_stand = way.goals[at, b]
            together.which[b] = way.nearest[at, b]
            step = ahead - trail.features[b, 0]
            pilots = place_of(guide, goal_stand) - place_of(guide, stand)
            beside = wp.length(place_of(guide, goal_stand) - ahead)
            away = wp.length(pilots - step) > _BESIDE * wp.length(step)
            away = away or beside > _BESIDE * wp.length(ahead)
            follows = straight[0] == 0 and way.guided[b] == 1 and not away
            if straight[0] == 0 and not follows:
                share = share_of(trail, b, ahead)
            trail.follows[b] = wp.where(follows, 1, 0)
            trail.share[b] = share
            goal = way.course[at, b]
            tip = way.tips[b] + wp.vec3d(goal[1], goal[2], wp.float64(0.0))
            height = tip[2] - goal[0]
            if way.pushed:
                height = trail.heights[b, 0]
                height += share * (height - trail.heights[b, 1])
                if follows:
                    height -= depth_at(guide, goal_stand) - depth_at(guide, stand)
                d.load[b] = goal[0] / way.copies
            poses.tips[b] = wp.vec3d(tip[0], tip[1], height)
            c = wp.cos(goal[3])
            s = wp.sin(goal[3])
            zero = wp.float64(0.0)
            turn = wp.mat33d(c, -s, zero, s, c, zero, zero, zero, wp.float64(1.0))
            poses.rotations[b] = turn * way.rotations[b]
            memory.counts[b] = 0
            memory.next[b] = 0
            d.status[b] = Status.RUNNING
            d.mode[b] = Mode.BEGIN
            d.wanted[b] = 1
            d.rough[b] = 1
            d.steps[b] = 0
            d.since[b] = 0
            d.recorded[b] = 0
            d.gripped_at[b] = wp.float64(1e300)
            d.grip_change[b] = wp.where(lags, wp.float64(1e300), wp.float64(0.0))
        if d.status[b] == Status.RUNNING:
            together.rank[b] = wp.atomic_add(together.counts, together.which[b], 1)
    wait_for_all()
    for k in range(thread, together.counts.shape[0], wp.block_dim()):
        share_out(together, k)


@wp.kernel(enable_backward=False)
def predict(
    # Model:
    guide: Guide,
    # Data in:
    way: Way,
    together: Together,
    trail: Trail,
    # Data out:
    slot_out: wp.array(dtype=wp.int32),
    positions_out: wp.array2d(dtype=wp.vec3d),
    elastic_out: wp.array2d(dtype=wp.vec3d),
    contact_out: wp.array2d(dtype=wp.vec3d),
):
    """Put the nodes to where a step starts; launches over [environment_count, node_count]."""
    b, n = wp.tid()
    if n == 0 and together.width > 0:
        slot_out[b] = together.first[together.which[b]] + together.rank[b]
    if trail.stage[b] == STARTS:
        last = trail.last[b, n]
        x = last + (last - trail.older[b, n]) * trail.share[b]
        if trail.follows[b] == 1:
            at = trail.frame[b]
            x += motion_at(guide, way.goals[at, b], n) - motion_at(guide, way.stands[at, b], n)
        positions_out[b, n] = x
        elastic_out[b, n] = wp.vec3d()
        contact_out[b, n] = wp.vec3d()


@wp.kernel(enable_backward=False)
def copy_grip(
    wanted: wp.array(dtype=wp.int32),
    goal: wp.int32,
    grip: GripArrays,
    grip_out: GripArrays,
):
    """Copy what points hold where ``wanted`` is the goal; launches over the points."""
    b, f, q = wp.tid()
    if wanted[b] == goal:
        grip_out.held[b, f, q] = grip.held[b, f, q]
        grip_out.anchors[b, f, q] = grip.anchors[b, f, q]
        grip_out.loads[b, f, q] = grip.loads[b, f, q]


@wp.kernel(enable_backward=False)
def remember(
    # Data in:
    positions: wp.array2d(dtype=wp.vec3d),
    # Data in and out:
    trail: Trail,
):
    """Take over what was found; launches over [environment_count, node_count]."""
    b, n = wp.tid()
    if trail.stage[b] == LANDS:
        trail.older[b, n] = trail.last[b, n]
        trail.last[b, n] = positions[b, n]


@wp.kernel(enable_backward=False)
def land(
    # Model:
    floor: wp.float64,
    # Data in:
    way: Way,
    poses: Poses,
    d: Descent,
    # Data in and out:
    trail: Trail,
    # Data out:
    found: Found,
):
    """Note what was found; who did not arrive takes no part from now on.

    Launches over [environment_count].
    """
    b = wp.tid()
    if trail.stage[b] >= STARTS and d.status[b] != Status.RUNNING:
        at = trail.frame[b]
        found.status[at, b] = d.status[b]
        if d.status[b] == Status.DONE:
            load = wp.max(d.scale[b], floor)
            found.push[at, b] = d.push[b]
            found.tips[at, b] = poses.tips[b]
            found.residual[at, b] = d.residual[b] / load
            found.imbalance[at, b] = d.vertical[b] / load
            found.gap[at, b] = d.gap_min[b]
            trail.features[b, 1] = trail.features[b, 0]
            trail.features[b, 0] = feature_at(way, at, b)
            trail.heights[b, 1] = trail.heights[b, 0]
            trail.heights[b, 0] = poses.tips[b][2]
            trail.frame[b] = at + 1
            trail.stage[b] = LANDS
        else:
            trail.active[b] = 0
            trail.stage[b] = WAITS
