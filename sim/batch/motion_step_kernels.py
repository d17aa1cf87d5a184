"""Warp kernels of frames: where each environment goes next, where it starts, what it found.

An environment goes from the pose of one frame to the next in parts, each a descent to equilibrium.
It goes on as soon as it has arrived, whatever the others do.
"""

import warp as wp

from sim.contact.barrier_and_friction_kernels import GripArrays
from sim.contact.indenter_distance import Poses
from sim.solve.descent_state import Descent, Mode, Status
from sim.solve.lbfgs_kernels import Memory

# A step continues the one before if it is so many times as long at most, and leads the same way.
_LONGER, _SAME = wp.constant(wp.float64(3.0)), wp.constant(wp.float64(0.9))
_NOTHING = wp.constant(wp.float64(1e-300))
# How often a load is corrected at most, the change of a bias that is none, and the largest bias.
_CORRECTIONS, _SAME_BIAS = wp.constant(8), wp.constant(wp.float64(5e-4))
_MOST_BIAS = wp.constant(wp.float64(0.5))
# What the known bias of a light contact may leave (``overlap_kernels``), relative to F_z.
_LIGHT_LEFT = wp.constant(wp.float64(0.035))
# How far above its first goal an indenter begins to come down [m].
_ABOVE = wp.constant(wp.float64(1.0))
# Where an environment is: it waits for its next part, is under way, or has come to a part's end
# where ``note`` has to say whether its load is corrected.
_WAITS, _UNDER_WAY, _IS_LOOKED_AT = wp.constant(0), wp.constant(1), wp.constant(2)
Known = wp.types.vector(length=6, dtype=wp.float64)  # factors of ``ForceBias.known``


@wp.struct
class Motions:
    """Where the environments go, shape [environment_count] where nothing is said."""

    # at the ends of frames: tip [m] and turn, shape [frame_count, environment_count]
    goals: wp.array2d(dtype=wp.transformd)
    loads: wp.array2d(dtype=wp.float64)  # that push the indenter [N], likewise
    pushed: wp.array(dtype=wp.int32)  # 1 where loads push it
    longest: wp.array(dtype=wp.float64)  # way of a part at most [m]
    standoff: wp.float64  # how much higher tips are held than ``goals`` say [m]
    starts: wp.array(dtype=wp.transformd)  # where the way to the next goal begins
    frame: wp.array(dtype=wp.int32)  # frames that are behind
    parts: wp.array(dtype=wp.int32)  # in how many parts the next one is gone; 0: not known yet
    done: wp.array(dtype=wp.int32)  # parts of it that are
    halved: wp.array(dtype=wp.int32)  # how often its parts were
    # residual over the contact force that is enough at a frame's end, and before, shape [2]
    enough: wp.array(dtype=wp.float64)


@wp.struct
class History:
    """Where the environments were, shape [environment_count, ...] each."""

    moves: wp.array(dtype=wp.int32)  # 1 where an environment has frames to go to
    lowered: wp.array(dtype=wp.int32)  # 1 where its indenter has come down to the gel
    comes: wp.array(dtype=wp.int32)  # 1 where it comes down now
    stage: wp.array(dtype=wp.int32)  # it waits for its next part, is under way or looked at
    arrives: wp.array(dtype=wp.int32)  # 1 where it has just arrived
    ends: wp.array(dtype=wp.int32)  # the frame whose end that is; -1 where it is no frame's
    gaps: wp.array2d(dtype=wp.float64)  # of the contact points there [m], shape [..., point_count]
    starts: wp.array(dtype=wp.int32)  # 1 where it has just begun a part
    settled: wp.array(dtype=wp.int32)  # parts since it was put back
    corrected: wp.array(dtype=wp.int32)  # how often the load of the next frame was
    evaluated: wp.array(dtype=wp.int32)  # evaluations up to the last frame
    bias: wp.array(dtype=wp.float64)  # of the last force, as ``ForceBias``
    touched: wp.array2d(dtype=wp.float64)  # what ``BatchKernels.wrench`` gives, shape [..., 13]
    light: wp.array(dtype=wp.vec3d)  # what ``overlap_kernels.overlap`` tells
    tips: wp.array2d(dtype=wp.vec3d)  # in the last two states, latest first [m], shape [..., 2]
    turns: wp.array(dtype=wp.quatd)  # in the last state, indenter frame to pad frame
    last: wp.array2d(dtype=wp.vec3d)  # nodes of the last state [m], shape [..., node_count]
    older: wp.array2d(dtype=wp.vec3d)  # of the one before
    share: wp.array(dtype=wp.float64)  # of the last step that the next one's start goes on by


@wp.struct
class Found:
    """What frames gave, shape [frame_count, environment_count, ...] each."""

    touched: wp.array3d(dtype=wp.float64)  # raw wrench [N, N m], and area [m^2], shape [..., 7]
    wrench: wp.array3d(dtype=wp.float64)  # without the mesh's bias, shape [..., 6]
    error: wp.array2d(dtype=wp.float64)  # what may remain of it, over the force
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
    d.first_try[b] = wp.float64(1.0)
    d.recorded[b] = 0
    d.damping[b] = 1
    d.gripped_at[b] = wp.float64(1e300)
    d.grip_change[b] = wp.where(lags, wp.float64(1e300), wp.float64(0.0))


@wp.func
def goal_of(motions: Motions, b: wp.int32) -> wp.transformd:
    """Return the pose at the end of the next frame, as it is held."""
    goal = motions.goals[motions.frame[b], b]
    up = wp.vec3d(wp.float64(0.0), wp.float64(0.0), motions.standoff)
    return wp.transformd(wp.transform_get_translation(goal) + up, wp.transform_get_rotation(goal))


@wp.func
def part_end(motions: Motions, b: wp.int32) -> wp.transformd:
    """Return the pose at the end of the part that is next or under way."""
    start, goal = motions.starts[b], goal_of(motions, b)
    gone = wp.float64(motions.done[b] + 1) / wp.float64(motions.parts[b])
    turn = wp.transform_get_rotation(goal)
    if gone < wp.float64(1.0):
        turn = wp.quat_slerp(wp.transform_get_rotation(start), turn, gone)
    tip = wp.transform_get_translation(start)
    return wp.transformd(tip + (wp.transform_get_translation(goal) - tip) * gone, turn)


@wp.func
def parts_of(
    start: wp.transformd, goal: wp.transformd, pushed: bool, longest: wp.float64, arm: wp.float64
) -> wp.int32:
    """Return in how many parts to go, each at most so long for the tip and for an arm [m]."""
    travel = wp.transform_get_translation(goal) - wp.transform_get_translation(start)
    if pushed:  # its height is found
        travel[2] = wp.float64(0.0)
    one, turned = wp.float64(1.0), wp.transform_get_rotation(goal)
    along = wp.float64(wp.abs(wp.dot(turned, wp.transform_get_rotation(start))))
    swept = arm * wp.float64(2.0) * wp.acos(wp.min(along, one))
    parts = wp.float64(wp.ceil((wp.length(travel) + swept) / longest - wp.float64(1e-9)))
    return wp.int32(wp.max(parts, one))


@wp.kernel(enable_backward=False)
def set_out(
    # Data in:
    motions: Motions,
    # Data in and out:
    history: History,
    poses: Poses,
    d: Descent,
    # Data out:
    new_out: wp.array(dtype=wp.int32),
):
    """Put indenters that come down anew above their first goals; over [environment_count]."""
    b = wp.tid()
    history.comes[b] = 0
    if history.moves[b] == 1:
        d.pushed[b] = motions.pushed[b]
        if history.lowered[b] == 0:
            new_out[0] = 1
            history.comes[b] = 1
            history.lowered[b] = 1
            goal = goal_of(motions, b)
            history.turns[b] = wp.transform_get_rotation(goal)
            tip = wp.transform_get_translation(goal)
            poses.tips[b] = wp.vec3d(tip[0], tip[1], tip[2] + _ABOVE)
            poses.rotations[b] = wp.quat_to_matrix(history.turns[b])


@wp.func
def pass_end(
    d: Descent, poses: Poses, motions: Motions, history: History, found: Found, b: wp.int32
):
    """Count a part that is behind; at the end of a frame, note what is known without its wrench."""
    motions.done[b] = motions.done[b] + 1
    f = motions.frame[b]
    if motions.done[b] == motions.parts[b]:
        load = wp.max(d.scale[b], d.floor[b])
        tip = poses.tips[b]
        found.tips[f, b] = wp.vec3d(tip[0], tip[1], tip[2] - motions.standoff)
        found.residual[f, b] = d.residual[b] / load
        found.imbalance[f, b] = d.vertical[b] / load
        found.evaluations[f, b] = d.evaluations[b] - history.evaluated[b]
        history.evaluated[b] = d.evaluations[b]
        motions.done[b] = 0
        motions.parts[b] = 0
        motions.halved[b] = 0
        motions.frame[b] = f + 1
        if f + 1 == motions.goals.shape[0]:
            history.moves[b] = 0


@wp.kernel(enable_backward=False)
def go_on(
    # Model:
    lags: wp.bool,
    arm: wp.float64,
    accepts_residual: wp.bool,
    halvings_max: wp.int32,
    evaluations_max: wp.int32,
    # Data in and out:
    motions: Motions,
    history: History,
    poses: Poses,
    d: Descent,
    memory: Memory,
    # Data out:
    seen: Poses,
    found: Found,
    busy_out: wp.array(dtype=wp.int32),
):
    """See who has arrived, at poses ``seen``, and begin parts; over [environment_count].

    Who does not arrive goes on from where it was in twice as many parts, or stays there. Who does
    goes on before its wrench is known, unless that may correct its load.
    """
    b = wp.tid()
    history.arrives[b] = 0
    history.starts[b] = 0
    pushed = d.pushed[b] == 1
    if history.stage[b] == _UNDER_WAY and d.status[b] != Status.RUNNING:
        history.stage[b] = _WAITS
        spent = d.evaluations[b] - history.evaluated[b]
        unfinished = accepts_residual and d.status[b] == Status.OUT_OF_STEPS
        if d.status[b] == Status.DONE or unfinished:
            history.arrives[b] = 1
            ends = motions.done[b] + 1 == motions.parts[b]
            history.ends[b] = wp.where(ends, motions.frame[b], -1)
            history.settled[b] = history.settled[b] + 1
            history.tips[b, 1] = history.tips[b, 0]
            history.tips[b, 0] = poses.tips[b]
            history.turns[b] = wp.transform_get_rotation(part_end(motions, b))
            seen.tips[b] = poses.tips[b]
            seen.rotations[b] = poses.rotations[b]
            if pushed:
                history.stage[b] = _IS_LOOKED_AT
                busy_out[0] = 1
            else:
                pass_end(d, poses, motions, history, found, b)
        elif motions.halved[b] < halvings_max and spent < evaluations_max:
            motions.halved[b] = motions.halved[b] + 1
            motions.starts[b] = wp.transformd(history.tips[b, 0], history.turns[b])
            motions.parts[b] = 2 * wp.max(motions.parts[b] - motions.done[b], 1)
            motions.done[b] = 0
        else:
            history.moves[b] = 0
            found.evaluations[motions.frame[b], b] = spent
            history.evaluated[b] = d.evaluations[b]
    if history.moves[b] == 1 and history.stage[b] == _WAITS:
        busy_out[0] = 1
        history.starts[b] = 1
        history.stage[b] = _UNDER_WAY
        if motions.parts[b] == 0:
            motions.starts[b] = wp.transformd(history.tips[b, 0], history.turns[b])
            goal, longest = goal_of(motions, b), motions.longest[b]
            motions.parts[b] = parts_of(motions.starts[b], goal, pushed, longest, arm)
        end = part_end(motions, b)
        to = wp.transform_get_translation(end)
        ahead = to - history.tips[b, 0]
        behind = history.tips[b, 0] - history.tips[b, 1]
        if pushed:
            ahead[2] = behind[2]
            to[2] = history.tips[b, 0][2]
        step, last = wp.length(ahead), wp.length(behind)
        share = wp.float64(0.0)
        same = wp.dot(ahead, behind) >= _SAME * step * last
        if history.settled[b] > 1 and step <= _LONGER * last and same:
            share = step / wp.max(last, _NOTHING)
        history.share[b] = share
        d.load[b] = wp.float64(0.0)
        if pushed:
            to[2] += share * behind[2]
            d.load[b] = motions.loads[motions.frame[b], b] * wp.exp(history.bias[b])
        poses.tips[b] = to
        poses.rotations[b] = wp.quat_to_matrix(wp.transform_get_rotation(end))
        d.relative[b] = motions.enough[wp.where(motions.done[b] + 1 == motions.parts[b], 0, 1)]
        start_descent(d, memory, b, lags)


@wp.kernel(enable_backward=False)
def take_over(
    gaps: wp.array2d(dtype=wp.float64),
    history: History,
    positions: wp.array2d(dtype=wp.vec3d),
    elastic_out: wp.array2d(dtype=wp.vec3d),
    contact_out: wp.array2d(dtype=wp.vec3d),
):
    """Keep where who has arrived is, and start parts; over [environment_count, node_count]."""
    b, n = wp.tid()
    if history.arrives[b] == 1:
        history.older[b, n] = history.last[b, n]
        history.last[b, n] = positions[b, n]
        for p in range(n, gaps.shape[1], positions.shape[1]):
            history.gaps[b, p] = gaps[b, p]
    if history.starts[b] == 1:
        last = history.last[b, n]
        positions[b, n] = last + (last - history.older[b, n]) * history.share[b]
        elastic_out[b, n] = wp.vec3d()
        contact_out[b, n] = wp.vec3d()


@wp.kernel(enable_backward=False)
def note(
    # Model:
    known: wp.array(dtype=Known),
    by_force: wp.array(dtype=wp.vec4d),
    left: wp.array(dtype=wp.vec2d),
    # Data in:
    d: Descent,
    poses: Poses,
    # Data in and out:
    motions: Motions,
    history: History,
    # Data out:
    found: Found,
):
    """Note the wrench of who has arrived; launches over [environment_count].

    A load is to be met without the mesh's bias (``sensor_model``), which is known once the contact
    is: it is corrected until its bias stands still.
    """
    b = wp.tid()
    if history.arrives[b] == 1:
        f, waits = history.ends[b], history.stage[b] == _IS_LOOKED_AT
        area, force = history.touched[b, 6], history.touched[b, 2]
        terms = Known()
        terms[0] = wp.float64(1.0)
        if area > wp.float64(0.0) and force > wp.float64(0.0):
            terms[1] = wp.pow(area, wp.float64(-0.75))
            terms[2] = history.touched[b, 7] * area / (force * force)
            terms[3] = history.touched[b, 8] / force
            terms[4] = force / area
            terms[5] = history.touched[b, 7] / wp.sqrt(area)
        by = by_force[b]
        x = wp.clamp(wp.log(wp.max(force, _NOTHING)), by[2], by[3])
        own = wp.clamp(wp.dot(known[b], terms), -_MOST_BIAS, _MOST_BIAS)
        light = history.light[b]
        if light[1] > _NOTHING and force > wp.float64(0.0):
            own += light[1] * (wp.log(force / light[0]) - own)
        own += (by[0] + by[1] * x) * x
        # Less and less of a change is taken over, since more load touches more, which is less bias.
        change = own - history.bias[b]
        history.bias[b] = history.bias[b] + change / wp.float64(1 + history.corrected[b] // 2)
        again = waits and f >= 0 and wp.abs(change) > _SAME_BIAS
        if again and history.corrected[b] < _CORRECTIONS:
            history.corrected[b] = history.corrected[b] + 1
        else:
            history.corrected[b] = 0
            if f >= 0:
                for k in range(7):
                    found.touched[f, b, k] = history.touched[b, k]
                for k in range(6):
                    found.wrench[f, b, k] = history.touched[b, k] * wp.exp(-own)
                narrow = left[b][1] * terms[1]
                beside = light[1] * (_LIGHT_LEFT - narrow) + light[2]
                found.error[f, b] = left[b][0] + narrow + beside
            if waits:
                pass_end(d, poses, motions, history, found, b)
        if waits:
            history.stage[b] = _WAITS


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
    away: wp.bool,
    # Data out:
    poses: Poses,
    d: Descent,
    history: History,
    positions_out: wp.array2d(dtype=wp.vec3d),
):
    """Put environments back to the untouched gel, their indenters where they are or 1 m above it.

    Launches over [environment_count, node_count].
    """
    b, n = wp.tid()
    if wanted[b] == 1:
        history.last[b, n] = nodes[n]
        history.older[b, n] = nodes[n]
        positions_out[b, n] = nodes[n]
        if n == 0:
            if away:
                poses.tips[b] = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
                history.lowered[b] = 0
                d.pushed[b] = 0
            history.tips[b, 0] = poses.tips[b]
            history.tips[b, 1] = poses.tips[b]
            history.settled[b] = 0
            history.corrected[b] = 0
            history.bias[b] = wp.float64(0.0)


@wp.kernel(enable_backward=False)
def let_go(wanted: wp.array(dtype=wp.int32), grip: GripArrays):
    """Let all points go of some environments; launches over the contact points."""
    b, f, q = wp.tid()
    if wanted[b] == 1:
        grip.held[b, f, q] = wp.float64(0.0)
        grip.loads[b, f, q] = wp.vec3d()


@wp.kernel(enable_backward=False)
def lower(
    wanted: wp.array(dtype=wp.int32),
    gaps: wp.array2d(dtype=wp.float64),
    motions: Motions,
    poses: Poses,
):
    """Lower indenters, where wanted, by their gap to the gel, to their goals at most.

    Coming from above they cannot end below its surface. Launches over [environment_count, threads
    of a block].
    """
    b, thread = wp.tid()
    gap = wp.float64(1e300)
    for p in range(thread, gaps.shape[1], wp.block_dim()):
        gap = wp.min(gap, gaps[b, p])
    nearest = wp.tile_reduce(wp.min, wp.tile(gap))
    if thread == 0 and wanted[b] == 1:
        tip, goal = poses.tips[b], wp.transform_get_translation(goal_of(motions, b))
        tip[2] = wp.max(tip[2] + motions.standoff - nearest[0], goal[2])
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
