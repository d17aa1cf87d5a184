"""Warp kernels of a step to other poses: where each environment starts, and what it found."""

from __future__ import annotations

import warp as wp

from sim.contact.contact_kernels import GripArrays
from sim.contact.indenter_distance import Poses
from sim.solve.descent_state import Descent, Mode, Status
from sim.solve.memory_kernels import Memory

# A step continues the one before if it is so many times as long at most, and leads the same way.
_LONGER, _SAME = wp.constant(wp.float64(3.0)), wp.constant(wp.float64(0.9))
_NOTHING = wp.constant(wp.float64(1e-300))


@wp.struct
class PoseHistory:
    """Where the environments were, shape [environment_count, ...] each."""

    moves: wp.array(dtype=wp.int32)  # 1 where an environment takes part in the step
    settled: wp.array(dtype=wp.int32)  # steps since it was put back
    tips: wp.array2d(dtype=wp.vec3d)  # in the last two states, latest first [m], shape [..., 2]
    last: wp.array2d(dtype=wp.vec3d)  # nodes of the last state [m], shape [..., node_count]
    older: wp.array2d(dtype=wp.vec3d)  # of the one before
    share: wp.array(dtype=wp.float64)  # of the last step that the next one's start goes on by


@wp.kernel(enable_backward=False)
def begin(
    # Model:
    lags: wp.bool,
    # Data in:
    goals: Poses,
    loads: wp.array(dtype=wp.float64),
    # Data in and out:
    history: PoseHistory,
    poses: Poses,
    d: Descent,
    memory: Memory,
    # Data out:
    busy_out: wp.array(dtype=wp.int32),
):
    """Let environments begin that take part; launches over [environment_count]."""
    b = wp.tid()
    if history.moves[b] == 1:
        busy_out[0] = 1
        goal = goals.tips[b]
        ahead = goal - history.tips[b, 0]
        behind = history.tips[b, 0] - history.tips[b, 1]
        if d.pushed[b] == 1:
            ahead[2] = behind[2]
            goal[2] = history.tips[b, 0][2]
        step, last = wp.length(ahead), wp.length(behind)
        share = wp.float64(0.0)
        same = wp.dot(ahead, behind) >= _SAME * step * last
        if history.settled[b] > 1 and step <= _LONGER * last and same:
            share = step / wp.max(last, _NOTHING)
        history.share[b] = share
        if d.pushed[b] == 1:
            goal[2] += share * behind[2]
        poses.tips[b] = goal
        poses.rotations[b] = goals.rotations[b]
        d.load[b] = loads[b]
        memory.counts[b] = 0
        memory.next[b] = 0
        d.status[b] = Status.RUNNING
        d.mode[b] = Mode.BEGIN
        d.wanted[b] = 1
        d.checked[b] = 1
        d.rough[b] = 1
        d.steps[b] = 0
        d.since[b] = 0
        d.recorded[b] = 0
        d.gripped_at[b] = wp.float64(1e300)
        d.grip_change[b] = wp.where(lags, wp.float64(1e300), wp.float64(0.0))


@wp.kernel(enable_backward=False)
def predict(
    history: PoseHistory,
    positions_out: wp.array2d(dtype=wp.vec3d),
    elastic_out: wp.array2d(dtype=wp.vec3d),
    contact_out: wp.array2d(dtype=wp.vec3d),
):
    """Put nodes to where a step starts; launches over [environment_count, node_count]."""
    b, n = wp.tid()
    if history.moves[b] == 1:
        last = history.last[b, n]
        positions_out[b, n] = last + (last - history.older[b, n]) * history.share[b]
        elastic_out[b, n] = wp.vec3d()
        contact_out[b, n] = wp.vec3d()


@wp.kernel(enable_backward=False)
def arrive(d: Descent, poses: Poses, history: PoseHistory):
    """Note who has arrived, by a 1 in ``moves``; launches over [environment_count]."""
    b = wp.tid()
    if history.moves[b] == 1:
        if d.status[b] == Status.DONE:
            history.settled[b] = history.settled[b] + 1
            history.tips[b, 1] = history.tips[b, 0]
            history.tips[b, 0] = poses.tips[b]
        else:
            history.moves[b] = 0


@wp.kernel(enable_backward=False)
def remember(positions: wp.array2d(dtype=wp.vec3d), history: PoseHistory):
    """Take over the nodes of who has arrived; launches over [environment_count, node_count]."""
    b, n = wp.tid()
    if history.moves[b] == 1:
        history.older[b, n] = history.last[b, n]
        history.last[b, n] = positions[b, n]


@wp.kernel(enable_backward=False)
def copy_grip(wanted: wp.array(dtype=wp.int32), grip: GripArrays, grip_out: GripArrays):
    """Copy what points hold where it is wanted; launches over the contact points."""
    b, f, q = wp.tid()
    if wanted[b] == 1:
        grip_out.held[b, f, q] = grip.held[b, f, q]
        grip_out.anchors[b, f, q] = grip.anchors[b, f, q]
        grip_out.loads[b, f, q] = grip.loads[b, f, q]


@wp.kernel(enable_backward=False)
def put_back(
    # Model:
    nodes: wp.array(dtype=wp.vec3d),
    # Data in:
    wanted: wp.array(dtype=wp.int32),
    poses: Poses,
    # Data out:
    history: PoseHistory,
    positions_out: wp.array2d(dtype=wp.vec3d),
):
    """Put environments back to the untouched gel; launches over [environment_count, node_count]."""
    b, n = wp.tid()
    if wanted[b] == 1:
        history.last[b, n] = nodes[n]
        history.older[b, n] = nodes[n]
        positions_out[b, n] = nodes[n]
        if n == 0:
            history.tips[b, 0] = poses.tips[b]
            history.tips[b, 1] = poses.tips[b]
            history.settled[b] = 0


@wp.kernel(enable_backward=False)
def let_go(wanted: wp.array(dtype=wp.int32), grip: GripArrays):
    """Let all points go of some environments; launches over the contact points."""
    b, f, q = wp.tid()
    if wanted[b] == 1:
        grip.held[b, f, q] = wp.float64(0.0)


@wp.kernel(enable_backward=False)
def lift(gaps: wp.array2d(dtype=wp.float64), least: wp.float64, poses: Poses):
    """Raise indenters that are nearer to the gel than ``least`` [m].

    Launches over [environment_count, threads of a block].
    """
    b, thread = wp.tid()
    gap = wp.float64(1e300)
    for p in range(thread, gaps.shape[1], wp.block_dim()):
        gap = wp.min(gap, gaps[b, p])
    nearest = wp.tile_reduce(wp.min, wp.tile(gap))
    if thread == 0:
        tip = poses.tips[b]
        tip[2] = tip[2] + wp.max(least - nearest[0], wp.float64(0.0))
        poses.tips[b] = tip
