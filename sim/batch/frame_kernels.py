"""Warp kernels of frames: where each environment goes next, where it starts, what it found.

An environment goes from the pose of one frame to the next in parts, each a descent to equilibrium.
It goes on as soon as it has arrived, whatever the others do.
"""

from __future__ import annotations

import warp as wp

from sim.contact.contact_kernels import GripArrays
from sim.contact.indenter_distance import Poses
from sim.solve.descent_state import Descent, Mode, Status
from sim.solve.memory_kernels import Memory

# A step continues the one before if it is so many times as long at most, and leads the same way.
_LONGER, _SAME = wp.constant(wp.float64(3.0)), wp.constant(wp.float64(0.9))
_NOTHING = wp.constant(wp.float64(1e-300))
# How often a load is corrected at most, and the change of a bias that is none.
_CORRECTIONS, _SAME_BIAS = wp.constant(8), wp.constant(wp.float64(5e-4))
# Where an environment is between two parts of its way.
_WAITS, _UNDER_WAY = wp.constant(0), wp.constant(1)


@wp.struct
class Motions:
    """Where the environments go, shape [frame_count, environment_count] where nothing is said."""

    tips: wp.array2d(dtype=wp.vec3d)  # where a frame begins [m]
    travels: wp.array2d(dtype=wp.vec3d)  # from there to its end [m]
    rotations: wp.array2d(dtype=wp.mat33d)  # where it begins, indenter frame to pad frame
    turns: wp.array2d(dtype=wp.vec3d)  # rotation vector from there to its end [rad]
    parts: wp.array2d(dtype=wp.int32)  # in how many parts it is gone
    loads: wp.array2d(dtype=wp.float64)  # that push the indenter [N]
    frame: wp.array(dtype=wp.int32)  # frames that are behind, shape [environment_count]
    done: wp.array(dtype=wp.int32)  # parts of the next one that are, likewise
    # residual over the contact force that is enough at a frame's end, and before, shape [2]
    enough: wp.array(dtype=wp.float64)


@wp.struct
class History:
    """Where the environments were, shape [environment_count, ...] each."""

    moves: wp.array(dtype=wp.int32)  # 1 where an environment has frames to go to
    stage: wp.array(dtype=wp.int32)  # it waits for its next part, or is under way
    arrives: wp.array(dtype=wp.int32)  # 1 where it has just arrived
    starts: wp.array(dtype=wp.int32)  # 1 where it has just begun a part
    settled: wp.array(dtype=wp.int32)  # parts since it was put back
    corrected: wp.array(dtype=wp.int32)  # how often the load of the next frame was
    evaluated: wp.array(dtype=wp.int32)  # evaluations up to the last frame
    bias: wp.array(dtype=wp.float64)  # of the last force, over it
    touched: wp.array2d(dtype=wp.float64)  # wrench, and area in contact, shape [..., 7]
    tips: wp.array2d(dtype=wp.vec3d)  # in the last two states, latest first [m], shape [..., 2]
    last: wp.array2d(dtype=wp.vec3d)  # nodes of the last state [m], shape [..., node_count]
    older: wp.array2d(dtype=wp.vec3d)  # of the one before
    share: wp.array(dtype=wp.float64)  # of the last step that the next one's start goes on by


@wp.struct
class Found:
    """What frames gave, shape [frame_count, environment_count, ...] each."""

    touched: wp.array3d(dtype=wp.float64)  # raw wrench [N, N m], and area [m^2], shape [..., 7]
    tips: wp.array2d(dtype=wp.vec3d)  # [m]
    residual: wp.array2d(dtype=wp.float64)  # norm of the unbalanced force over the contact force
    # base reaction against the indenter's force, over the latter
    imbalance: wp.array2d(dtype=wp.float64)
    evaluations: wp.array2d(dtype=wp.int32)


@wp.func
def start_descent(d: Descent, memory: Memory, b: wp.int32, lags: wp.bool):
    """Let an environment begin a descent, with nothing learnt of another."""
    memory.counts[b] = 0
    memory.next[b] = 0
    d.status[b] = Status.RUNNING
    d.mode[b] = Mode.BEGIN
    d.wanted[b] = 1
    d.rough[b] = 1
    d.checked[b] = 1
    d.steps[b] = 0
    d.since[b] = 0
    d.fraction[b] = wp.float64(1.0)
    d.recorded[b] = 0
    d.gripped_at[b] = wp.float64(1e300)
    d.grip_change[b] = wp.where(lags, wp.float64(1e300), wp.float64(0.0))


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
    motions: Motions,
    # Data in and out:
    history: History,
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
        f = motions.frame[b]
        part, parts = motions.done[b] + 1, motions.parts[f, b]
        gone = wp.float64(part) / wp.float64(parts)
        goal = motions.tips[f, b] + motions.travels[f, b] * gone
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
        poses.rotations[b] = turn_by(motions.turns[f, b] * gone) * motions.rotations[f, b]
        d.load[b] = motions.loads[f, b] * (wp.float64(1.0) + history.bias[b])
        d.relative[b] = motions.enough[wp.where(part == parts, 0, 1)]
        start_descent(d, memory, b, lags)


@wp.kernel(enable_backward=False)
def predict(
    history: History,
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
def arrive(accepts_residual: wp.bool, d: Descent, poses: Poses, history: History):
    """Note who has arrived, and who will not; launches over [environment_count]."""
    b = wp.tid()
    history.arrives[b] = 0
    if history.stage[b] == _UNDER_WAY and d.status[b] != Status.RUNNING:
        history.stage[b] = _WAITS
        unfinished = accepts_residual and d.status[b] == Status.OUT_OF_STEPS
        if d.status[b] == Status.DONE or unfinished:
            history.arrives[b] = 1
            history.settled[b] = history.settled[b] + 1
            history.tips[b, 1] = history.tips[b, 0]
            history.tips[b, 0] = poses.tips[b]
            for k in range(7):
                history.touched[b, k] = wp.float64(0.0)
        else:
            history.moves[b] = 0


@wp.kernel(enable_backward=False)
def note(
    # Model:
    floor: wp.float64,
    bias: wp.array(dtype=wp.float64),
    slope: wp.float64,
    # Data in:
    d: Descent,
    poses: Poses,
    # Data in and out:
    motions: Motions,
    history: History,
    # Data out:
    found: Found,
):
    """Note what was found by who has arrived; launches over [environment_count].

    A load is to be met without the mesh's bias (``sensor_model``), which is known once the contact
    is: it is corrected until its bias stands still.
    """
    b = wp.tid()
    if history.arrives[b] == 1:
        f = motions.frame[b]
        ends = motions.done[b] + 1 == motions.parts[f, b]
        own = bias[b]
        if history.touched[b, 6] > wp.float64(0.0):
            own += slope * wp.pow(history.touched[b, 6], wp.float64(-0.75))
        # Less and less of a change is taken over, since more load touches more, which is less bias.
        change = own - history.bias[b]
        history.bias[b] = history.bias[b] + change / wp.float64(1 + history.corrected[b])
        again = d.pushed[b] == 1 and wp.abs(change) > _SAME_BIAS
        if ends and again and history.corrected[b] < _CORRECTIONS:
            history.corrected[b] = history.corrected[b] + 1
        else:
            history.corrected[b] = 0
            motions.done[b] = motions.done[b] + 1
            if ends:
                load = wp.max(d.scale[b], floor)
                for k in range(7):
                    found.touched[f, b, k] = history.touched[b, k]
                found.tips[f, b] = poses.tips[b]
                found.residual[f, b] = d.residual[b] / load
                found.imbalance[f, b] = d.vertical[b] / load
                found.evaluations[f, b] = d.evaluations[b] - history.evaluated[b]
                history.evaluated[b] = d.evaluations[b]
                motions.done[b] = 0
                motions.frame[b] = f + 1
                if f + 1 == motions.parts.shape[0]:
                    history.moves[b] = 0


@wp.kernel(enable_backward=False)
def remember(positions: wp.array2d(dtype=wp.vec3d), history: History):
    """Take over the nodes of who has arrived; launches over [environment_count, node_count]."""
    b, n = wp.tid()
    if history.arrives[b] == 1:
        history.older[b, n] = history.last[b, n]
        history.last[b, n] = positions[b, n]


@wp.kernel(enable_backward=False)
def copy_grip(wanted: wp.array(dtype=wp.int32), grip: GripArrays, grip_out: GripArrays):
    """Copy what points hold where it is wanted; launches over the points."""
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
    history: History,
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
            history.bias[b] = wp.float64(0.0)


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
