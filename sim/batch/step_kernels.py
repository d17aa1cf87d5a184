"""Warp kernels of a step of a batch: where every environment starts from, and what it found.

A step takes each environment's indenter to a pose or a load. As long as it follows the pilot's
path, it starts with the motion that the pilot made there. Otherwise it starts where the last two
states lead if it goes in the direction of the step before; else from the last one. Along a
trajectory an environment goes on to its next frame as soon as it has arrived, unless it would need
an inverse far from those that serve the others.
"""

from __future__ import annotations

import warp as wp

from sim.batch.pilot_path import (
    SAME_DIRECTION,
    PathPosition,
    PilotPath,
    coordinates_at,
    depth_at,
    motion_at,
    path_positions,
)
from sim.contact.contact_kernels import GripArrays
from sim.contact.indenter_distance import Poses
from sim.solve.descent_state import Descent, Mode, Status
from sim.solve.memory_kernels import Memory, wait_for_all

# A step continues the one before if it is so many times as long at most.
_LONGER = wp.constant(wp.float64(3.0))
_NOTHING = wp.constant(wp.float64(1e-300))
# A step follows the pilot if it differs from the pilot's by no more than this share of its length,
# and ends no further beside it than this share of the distance from first touch.
_BESIDE = wp.constant(wp.float64(0.5))
_NEVER = wp.constant(2**30)

# Stages of an environment.
WAITS = wp.constant(0)
ARRIVED = wp.constant(1)  # it has just arrived
STARTS = wp.constant(2)
UNDER_WAY = wp.constant(3)


@wp.struct
class Trajectories:
    """Where the environments begin and go, frame by frame."""

    tips: wp.array(dtype=wp.vec3d)  # of the indenter at first touch [m], shape [environment_count]
    rotations: wp.array(dtype=wp.mat33d)  # indenter frame to pad frame, there
    # depth [m] or force on the whole pad [N], shift along x and y [m], turn about z [rad], of shape
    # frame_count by environment_count
    goals: wp.array2d(dtype=wp.vec4d)
    until: wp.array(dtype=wp.int32)  # the frame to go to at most, shape [1]
    metres: wp.vec2d  # depth for a newton [m/N], distance for a radian [m]
    copies: wp.float64  # of the modelled part in the whole pad
    pushed: wp.bool  # the force is given, and counts times ``shares``
    # E of the pilot's gel over their own, shape [environment_count]
    shares: wp.array(dtype=wp.float64)
    # 1 where the indenter comes down where the pilot's did, shape [environment_count]
    guided: wp.array(dtype=wp.int32)
    # where on the pilot's path a frame begins, and where it ends; of the shape of ``goals``
    starts: wp.array2d(dtype=PathPosition)
    ends: wp.array2d(dtype=PathPosition)
    nearest: wp.array2d(dtype=wp.int32)  # the kept state of the pilot that is nearest to its end


@wp.struct
class History:
    """The last states, shape [environment_count, ...] each."""

    active: wp.array(dtype=wp.int32)  # 1 where an environment takes part in the step
    stage: wp.array(dtype=wp.int32)  # where it is between two frames
    frame: wp.array(dtype=wp.int32)  # frames that it has behind it
    # of the last step: so far the next one's start is beyond the last state
    share: wp.array(dtype=wp.float64)
    follows: wp.array(dtype=wp.int32)  # 1 where the step follows the pilot's path
    # of the last two states, latest first, shape [..., 2]: along x and y, depth or load, turn; each
    # in metres
    coordinates: wp.array2d(dtype=wp.vec4d)
    heights: wp.array2d(dtype=wp.float64)  # of the indenter's tip in them [m], shape [..., 2]
    # nodes of the last state [m], shape [..., node_count]; ``older`` of the one before
    last: wp.array2d(dtype=wp.vec3d)
    older: wp.array2d(dtype=wp.vec3d)


@wp.struct
class InverseSharing:
    """How environments share the pilot's inverses.

    An inverse multiplies some vectors at once: those whose environments it serves lie in columns
    beside each other, in blocks of a width.
    """

    which: wp.array(dtype=wp.int32)  # inverse that serves an environment, shape [environment_count]
    rank: wp.array(dtype=wp.int32)  # of the environment among those that it serves, likewise
    counts: wp.array(dtype=wp.int32)  # environments that an inverse serves, shape [state_count]
    first: wp.array(dtype=wp.int32)  # their first column, likewise
    # inverse of every block of columns, -1 for none, shape [block_count]
    blocks: wp.array(dtype=wp.int32)
    width: wp.int32  # columns of a block; 0 where every environment keeps its own column
    # who is not the slowest needs an inverse that is so many frames after it at most
    ahead: wp.int32


@wp.struct
class StepResults:
    """What a step gives, shape [frame_count, environment_count] each."""

    push: wp.array2d(dtype=wp.vec3d)  # force on the indenter, modelled part [N]
    tips: wp.array2d(dtype=wp.vec3d)  # of the indenter [m]
    residual: wp.array2d(dtype=wp.float64)  # norm of the unbalanced force over the contact force
    # base reaction against the indenter's force, over the latter
    imbalance: wp.array2d(dtype=wp.float64)
    gap: wp.array2d(dtype=wp.float64)  # the smallest [m]
    status: wp.array2d(dtype=wp.int32)  # how the descent ended


@wp.func
def coordinates_of(trajectories: Trajectories, frame: wp.int32, b: wp.int32) -> wp.vec4d:
    """Return the coordinates that an environment goes to in a frame, each in metres."""
    goal = trajectories.goals[frame, b]
    along = goal[0]
    if trajectories.pushed:
        along = along * trajectories.metres[0] * trajectories.shares[b]
    return wp.vec4d(goal[1], goal[2], along, goal[3] * trajectories.metres[1])


@wp.kernel(enable_backward=False)
def locate(
    # Model:
    path: PilotPath,
    # Data in:
    history: History,
    # Data in and out:
    trajectories: Trajectories,
):
    """Find the frames' positions on the pilot's path; launches as ``goals`` has its shape."""
    frame, b = wp.tid()
    before = history.coordinates[b, 0]
    if frame > 0:
        before = coordinates_of(trajectories, frame - 1, b)
    began, ends, nearest = path_positions(path, before, coordinates_of(trajectories, frame, b))
    trajectories.starts[frame, b] = began
    trajectories.ends[frame, b] = ends
    trajectories.nearest[frame, b] = nearest


@wp.func
def _goes_on(trajectories: Trajectories, history: History, b: wp.int32) -> wp.bool:
    return history.active[b] == 1 and history.frame[b] < trajectories.until[0]


@wp.func
def share_out(sharing: InverseSharing, k: wp.int32):
    """Give an inverse columns after those of the ones before it."""
    before = wp.int32(0)
    whole = wp.int32(0)
    own = wp.int32(0)
    if sharing.width > 0:
        for other in range(sharing.counts.shape[0]):
            blocks = (sharing.counts[other] + sharing.width - 1) / sharing.width
            whole += blocks
            if other < k:
                before += blocks
            if other == k:
                own = blocks
    sharing.first[k] = before * sharing.width
    for block in range(before, before + own):
        sharing.blocks[block] = k
    for block in range(whole + k, sharing.blocks.shape[0], sharing.counts.shape[0]):
        sharing.blocks[block] = -1


@wp.func
def share_of(history: History, b: wp.int32, goal: wp.vec4d) -> wp.float64:
    """Return the next step over the last one; zero where it leads elsewhere or much farther."""
    ahead = goal - history.coordinates[b, 0]
    behind = history.coordinates[b, 0] - history.coordinates[b, 1]
    step = wp.length(ahead)
    last = wp.length(behind)
    share = wp.float64(0.0)
    if step <= _LONGER * last and wp.dot(ahead, behind) > SAME_DIRECTION * step * last:
        share = step / last
    return share


@wp.func
def start_descent(d: Descent, memory: Memory, b: wp.int32, lags: wp.bool):
    """Let an environment begin a descent, with nothing learnt of another."""
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


@wp.kernel(enable_backward=False)
def begin(
    # Model:
    lags: wp.bool,
    path: PilotPath,
    # Data in:
    trajectories: Trajectories,
    sharing: InverseSharing,
    straight: wp.array(dtype=wp.int32),
    # Data in and out:
    history: History,
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
    count = history.active.shape[0]
    # What the slowest has behind it, and the first of the frames whose inverses are needed.
    own = wp.vec2i(_NEVER, _NEVER)
    for b in range(thread, count, wp.block_dim()):
        if _goes_on(trajectories, history, b):
            at = history.frame[b]
            own = wp.min(own, wp.vec2i(at, path.frames[trajectories.nearest[at, b]]))
    for k in range(thread, sharing.counts.shape[0], wp.block_dim()):
        sharing.counts[k] = 0
    least = wp.tile_reduce(wp.min, wp.tile(own, preserve_type=True))
    slowest = least[0]
    wait_for_all()
    for b in range(thread, count, wp.block_dim()):
        stage = history.stage[b]
        if stage == STARTS:
            history.stage[b] = UNDER_WAY
        if stage == ARRIVED:
            history.stage[b] = WAITS
        at = history.frame[b]
        starts = stage < STARTS and _goes_on(trajectories, history, b)
        if starts and at > slowest[0]:
            starts = path.frames[trajectories.nearest[at, b]] <= slowest[1] + sharing.ahead
        if starts:
            history.stage[b] = STARTS
            busy_out[0] = 1
            ahead = coordinates_of(trajectories, at, b)
            share = wp.float64(0.0)
            start = trajectories.starts[at, b]
            end = trajectories.ends[at, b]
            sharing.which[b] = trajectories.nearest[at, b]
            step = ahead - history.coordinates[b, 0]
            pilots = coordinates_at(path, end) - coordinates_at(path, start)
            beside = wp.length(coordinates_at(path, end) - ahead)
            away = wp.length(pilots - step) > _BESIDE * wp.length(step)
            away = away or beside > _BESIDE * wp.length(ahead)
            follows = straight[0] == 0 and trajectories.guided[b] == 1 and not away
            if straight[0] == 0 and not follows:
                share = share_of(history, b, ahead)
            history.follows[b] = wp.where(follows, 1, 0)
            history.share[b] = share
            goal = trajectories.goals[at, b]
            tip = trajectories.tips[b] + wp.vec3d(goal[1], goal[2], wp.float64(0.0))
            height = tip[2] - goal[0]
            if trajectories.pushed:
                height = history.heights[b, 0]
                height += share * (height - history.heights[b, 1])
                if follows:
                    height -= depth_at(path, end) - depth_at(path, start)
                d.load[b] = goal[0] / trajectories.copies
            poses.tips[b] = wp.vec3d(tip[0], tip[1], height)
            c = wp.cos(goal[3])
            s = wp.sin(goal[3])
            zero = wp.float64(0.0)
            turn = wp.mat33d(c, -s, zero, s, c, zero, zero, zero, wp.float64(1.0))
            poses.rotations[b] = turn * trajectories.rotations[b]
            start_descent(d, memory, b, lags)
        if d.status[b] == Status.RUNNING:
            sharing.rank[b] = wp.atomic_add(sharing.counts, sharing.which[b], 1)
    wait_for_all()
    for k in range(thread, sharing.counts.shape[0], wp.block_dim()):
        share_out(sharing, k)


@wp.kernel(enable_backward=False)
def predict(
    # Model:
    path: PilotPath,
    # Data in:
    trajectories: Trajectories,
    sharing: InverseSharing,
    history: History,
    # Data out:
    slot_out: wp.array(dtype=wp.int32),
    positions_out: wp.array2d(dtype=wp.vec3d),
    elastic_out: wp.array2d(dtype=wp.vec3d),
    contact_out: wp.array2d(dtype=wp.vec3d),
):
    """Put the nodes to where a step starts; launches over [environment_count, node_count]."""
    b, n = wp.tid()
    if n == 0 and sharing.width > 0:
        slot_out[b] = sharing.first[sharing.which[b]] + sharing.rank[b]
    if history.stage[b] == STARTS:
        last = history.last[b, n]
        x = last + (last - history.older[b, n]) * history.share[b]
        if history.follows[b] == 1:
            at = history.frame[b]
            end = motion_at(path, trajectories.ends[at, b], n)
            x += end - motion_at(path, trajectories.starts[at, b], n)
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
    history: History,
):
    """Take over what was found; launches over [environment_count, node_count]."""
    b, n = wp.tid()
    if history.stage[b] == ARRIVED:
        history.older[b, n] = history.last[b, n]
        history.last[b, n] = positions[b, n]


@wp.kernel(enable_backward=False)
def end(
    # Model:
    floor: wp.float64,
    # Data in:
    trajectories: Trajectories,
    poses: Poses,
    d: Descent,
    # Data in and out:
    history: History,
    # Data out:
    found: StepResults,
):
    """Note what was found; who did not arrive takes no part from now on.

    Launches over [environment_count].
    """
    b = wp.tid()
    if history.stage[b] >= STARTS and d.status[b] != Status.RUNNING:
        at = history.frame[b]
        found.status[at, b] = d.status[b]
        if d.status[b] == Status.DONE:
            load = wp.max(d.scale[b], floor)
            found.push[at, b] = d.push[b]
            found.tips[at, b] = poses.tips[b]
            found.residual[at, b] = d.residual[b] / load
            found.imbalance[at, b] = d.vertical[b] / load
            found.gap[at, b] = d.gap_min[b]
            history.coordinates[b, 1] = history.coordinates[b, 0]
            history.coordinates[b, 0] = coordinates_of(trajectories, at, b)
            history.heights[b, 1] = history.heights[b, 0]
            history.heights[b, 0] = poses.tips[b][2]
            history.frame[b] = at + 1
            history.stage[b] = ARRIVED
        else:
            history.active[b] = 0
            history.stage[b] = WAITS
