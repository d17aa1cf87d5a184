"""Warp kernels of a step to other poses: where each environment starts, and what it found."""

from __future__ import annotations

import warp as wp

from sim.batch.step_kernels import start_descent
from sim.contact.contact_kernels import GripArrays
from sim.contact.indenter_distance import Poses
from sim.solve.descent_state import Descent, Status
from sim.solve.memory_kernels import Memory

# A step continues the one before if it is so many times as long at most, and leads the same way.
_LONGER, _SAME = wp.constant(wp.float64(3.0)), wp.constant(wp.float64(0.9))
_NOTHING = wp.constant(wp.float64(1e-300))


# Where an environment is between two parts of its way.
_WAITS, _UNDER_WAY = wp.constant(0), wp.constant(1)


@wp.struct
class Ways:
    """Where the environments go in a step, shape [environment_count] each."""

    tips: wp.array(dtype=wp.vec3d)  # where the way begins [m]
    travels: wp.array(dtype=wp.vec3d)  # from there to its end [m]
    rotations: wp.array(dtype=wp.mat33d)  # where it begins, indenter frame to pad frame
    turns: wp.array(dtype=wp.vec3d)  # rotation vector from there to its end [rad]
    parts: wp.array(dtype=wp.int32)  # in how many parts it is gone
    done: wp.array(dtype=wp.int32)  # parts that are behind
    loads: wp.array(dtype=wp.float64)  # that push the indenter [N]
    # residual over the contact force that is enough at the end, and before, shape [2]
    enough: wp.array(dtype=wp.float64)


@wp.struct
class PoseHistory:
    """Where the environments were, shape [environment_count, ...] each."""

    moves: wp.array(dtype=wp.int32)  # 1 where an environment has parts of its way to go
    stage: wp.array(dtype=wp.int32)  # it waits for its next part, or is under way
    arrives: wp.array(dtype=wp.int32)  # 1 where it has just arrived
    starts: wp.array(dtype=wp.int32)  # 1 where it has just begun a part
    settled: wp.array(dtype=wp.int32)  # parts since it was put back
    tips: wp.array2d(dtype=wp.vec3d)  # in the last two states, latest first [m], shape [..., 2]
    last: wp.array2d(dtype=wp.vec3d)  # nodes of the last state [m], shape [..., node_count]
    older: wp.array2d(dtype=wp.vec3d)  # of the one before
    share: wp.array(dtype=wp.float64)  # of the last step that the next one's start goes on by


@wp.func
def turn_by(v: wp.vec3d) -> wp.mat33d:
    """Return the rotation by a rotation vector [rad] (Rodrigues)."""
    zero, one = wp.float64(0.0), wp.float64(1.0)
    angle = wp.length(v)
    n = v / wp.max(angle, _NOTHING)
    K = wp.mat33d(zero, -n[2], n[1], n[2], zero, -n[0], -n[1], n[0], zero)
    return wp.identity(n=3, dtype=wp.float64) + K * wp.sin(angle) + K * K * (one - wp.cos(angle))


@wp.kernel(enable_backward=False)
def begin(
    # Model:
    lags: wp.bool,
    # Data in:
    ways: Ways,
    # Data in and out:
    history: PoseHistory,
    poses: Poses,
    d: Descent,
    memory: Memory,
    # Data out:
    busy_out: wp.array(dtype=wp.int32),
):
    """Let environments begin the next part that wait for it; over [environment_count]."""
    b = wp.tid()
    history.starts[b] = 0
    if history.moves[b] == 1 and history.stage[b] == _WAITS:
        busy_out[0] = 1
        history.starts[b] = 1
        history.stage[b] = _UNDER_WAY
        part, parts = ways.done[b] + 1, ways.parts[b]
        gone = wp.float64(part) / wp.float64(parts)
        goal = ways.tips[b] + ways.travels[b] * gone
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
        poses.rotations[b] = turn_by(ways.turns[b] * gone) * ways.rotations[b]
        d.load[b] = ways.loads[b]
        d.relative[b] = ways.enough[wp.where(part == parts, 0, 1)]
        start_descent(d, memory, b, lags)
        d.checked[b] = 1


@wp.kernel(enable_backward=False)
def predict(
    history: PoseHistory,
    positions_out: wp.array2d(dtype=wp.vec3d),
    elastic_out: wp.array2d(dtype=wp.vec3d),
    contact_out: wp.array2d(dtype=wp.vec3d),
):
    """Put nodes to where a part starts; launches over [environment_count, node_count]."""
    b, n = wp.tid()
    if history.starts[b] == 1:
        last = history.last[b, n]
        positions_out[b, n] = last + (last - history.older[b, n]) * history.share[b]
        elastic_out[b, n] = wp.vec3d()
        contact_out[b, n] = wp.vec3d()


@wp.kernel(enable_backward=False)
def arrive(d: Descent, poses: Poses, ways: Ways, history: PoseHistory):
    """Note who has arrived, and who will not; launches over [environment_count]."""
    b = wp.tid()
    history.arrives[b] = 0
    if history.stage[b] == _UNDER_WAY and d.status[b] != Status.RUNNING:
        history.stage[b] = _WAITS
        if d.status[b] == Status.DONE:
            history.arrives[b] = 1
            history.settled[b] = history.settled[b] + 1
            history.tips[b, 1] = history.tips[b, 0]
            history.tips[b, 0] = poses.tips[b]
            ways.done[b] = ways.done[b] + 1
        if d.status[b] != Status.DONE or ways.done[b] == ways.parts[b]:
            history.moves[b] = 0


@wp.kernel(enable_backward=False)
def remember(positions: wp.array2d(dtype=wp.vec3d), history: PoseHistory):
    """Take over the nodes of who has arrived; launches over [environment_count, node_count]."""
    b, n = wp.tid()
    if history.arrives[b] == 1:
        history.older[b, n] = history.last[b, n]
        history.last[b, n] = positions[b, n]


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


@wp.kernel(enable_backward=False)
def per_area(
    areas: wp.array(dtype=wp.float64),
    pressed: wp.array2d(dtype=wp.float64),
    sheared: wp.array2d(dtype=wp.vec3d),
):
    """Turn forces [N] at nodes into tractions [Pa]; launches over [environment_count, nodes]."""
    b, n = wp.tid()
    if areas[n] > wp.float64(0.0):
        pressed[b, n] = pressed[b, n] / areas[n]
        sheared[b, n] = sheared[b, n] / areas[n]
