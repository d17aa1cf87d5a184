"""Warp kernels of contact between gels and a simulator's bodies: who touches, and what acts.

All launch over the gels.
"""

import warp as wp

from sim.batch.motion_step_kernels import Found

_ZERO, _ONE = wp.constant(wp.float64(0.0)), wp.constant(wp.float64(1.0))
_NOTHING = wp.constant(wp.float64(1e-300))
# An object this near to the gel [m] is pressed; one farther away touches nothing.
_NEAR = wp.constant(wp.float64(0.2e-3))
# Cosine of the tilt from which a cylinder, whose axis does not end, may touch with its side; it
# then reaches anywhere [m].
_UPRIGHT, _ANYWHERE = wp.constant(wp.float64(0.7)), wp.constant(wp.float64(1e9))

Pose = wp.transformd
"""Position [m] and quaternion (x, y, z, w)."""


@wp.struct
class Bodies:
    """Rigid bodies in the world, those with gels or those that press, shape [count] each."""

    # A gel's: the middle of its base, with z out of the gel. An object's: the lowest point of its
    # shape, with z away from the gel.
    frames: wp.array(dtype=wp.transformd)
    centres: wp.array(dtype=wp.vec3d)  # of mass [m]
    velocities: wp.array(dtype=wp.vec3d)  # of these [m/s]
    spins: wp.array(dtype=wp.vec3d)  # [rad/s]
    inverse_masses: wp.array(dtype=wp.float64)  # [1/kg], zero for a body that is held
    inverse_inertias: wp.array(dtype=wp.mat33d)  # about the centres, along the world's axes


@wp.kernel(enable_backward=False)
def meet(
    # Model:
    half: wp.vec3d,  # extents of the pad to both sides, and its height [m]
    ball: wp.vec2d,  # height above the tip of the middle of a ball around the shape; radius [m]
    is_rod: wp.bool,
    # Data in:
    pads: Bodies,
    objects: Bodies,
    # Data in and out:
    near: wp.array(dtype=wp.int32),
    # Data out:
    leaves_out: wp.array(dtype=wp.bool),
    poses_out: wp.array(dtype=wp.transformd),
):
    """Set objects' poses in the gels' frames, and which are near, or were and are no longer."""
    b = wp.tid()
    pose = wp.transform_multiply(wp.transform_inverse(pads.frames[b]), objects.frames[b])
    middle = wp.transform_point(pose, wp.vec3d(_ZERO, _ZERO, ball[0]))
    up = wp.transform_vector(pose, wp.vec3d(_ZERO, _ZERO, _ONE))
    reach = ball[1]
    if is_rod and up[2] < _UPRIGHT:
        reach = _ANYWHERE
    beside = wp.max(wp.abs(middle[0]) - half[0], wp.abs(middle[1]) - half[1])
    now = wp.int32(0)
    # Below its base nothing is pressed.
    if middle[2] > _ZERO and middle[2] - reach < half[2] + _NEAR and beside < reach:
        now = wp.int32(1)
    leaves_out[b] = near[b] > now
    near[b] = now
    poses_out[b] = pose


@wp.kernel(enable_backward=False)
def forget(
    which: wp.array(dtype=wp.bool),
    near_out: wp.array(dtype=wp.int32),
    wrench_out: wp.array2d(dtype=wp.float64),
    error_out: wp.array(dtype=wp.float64),
    valid_out: wp.array(dtype=wp.bool),
    chosen_out: wp.array(dtype=wp.int32),
):
    """Let nothing touch some gels, and name them by numbers."""
    b = wp.tid()
    chosen_out[b] = wp.where(which[b], 1, 0)
    if which[b]:
        near_out[b] = 0
        error_out[b] = _ZERO
        valid_out[b] = True
        for k in range(6):
            wrench_out[b, k] = _ZERO


@wp.kernel(enable_backward=False)
def take(
    found: Found,
    near: wp.array(dtype=wp.int32),
    wrench_out: wp.array2d(dtype=wp.float64),
    error_out: wp.array(dtype=wp.float64),
    radii_out: wp.array(dtype=wp.float64),
    valid_out: wp.array(dtype=wp.bool),
):
    """Take over what was found; a wrench stays where no equilibrium was."""
    b = wp.tid()
    arrived = wp.isfinite(found.residual[0, b])
    valid_out[b] = near[b] == 0 or arrived
    if near[b] == 1:
        error_out[b] = found.error[0, b]
        if arrived:
            radii_out[b] = wp.sqrt(found.touched[0, b, 6] / wp.float64(wp.pi))
            for k in range(6):
                wrench_out[b, k] = found.wrench[0, b, k]


@wp.func
def velocity(bodies: Bodies, b: wp.int32, point: wp.vec3d) -> wp.vec3d:
    """Return the velocity of a body's point [m/s]."""
    return bodies.velocities[b] + wp.cross(bodies.spins[b], point - bodies.centres[b])


@wp.func
def mobility(bodies: Bodies, b: wp.int32, point: wp.vec3d, turn: wp.mat33d) -> wp.spatial_matrixd:
    """Return linear and angular acceleration at a point per wrench there, along turned axes."""
    arm, back = -wp.skew(point - bodies.centres[b]), wp.transpose(turn)
    inertia = bodies.inverse_inertias[b]
    pushed = wp.identity(n=3, dtype=wp.float64) * bodies.inverse_masses[b]
    pushed = back * (pushed + arm * inertia * wp.transpose(arm)) * turn
    coupled, spun = back * arm * inertia * turn, back * inertia * turn
    made = wp.spatial_matrixd()
    for i in range(3):
        for j in range(3):
            made[i, j] = pushed[i, j]
            made[i, j + 3] = coupled[i, j]
            made[j + 3, i] = coupled[i, j]
            made[i + 3, j + 3] = spun[i, j]
    return made


@wp.func
def felt_by(
    bodies: Bodies, b: wp.int32, tip: wp.vec3d, force: wp.vec3d, moment: wp.vec3d
) -> wp.spatial_vectord:
    """Return force, and moment about a body's centre of mass, of a wrench at the tip."""
    about = moment + wp.cross(tip - bodies.centres[b], force)
    return wp.spatial_vectord(force[0], force[1], force[2], about[0], about[1], about[2])


@wp.kernel(enable_backward=False)
def react(
    # Model:
    stiffness: wp.spatial_vectord,  # of a disc of radius 1 m in a half-space [N/m, N m]
    friction: wp.float64,
    loss: wp.float64,  # [s]
    step: wp.float64,  # of the engine [s]
    # Data in:
    pads: Bodies,
    objects: Bodies,
    radii: wp.array(dtype=wp.float64),  # of discs as large as what touches [m]
    wrench: wp.array2d(dtype=wp.float64),
    # Data out:
    on_pads_out: wp.array(dtype=wp.spatial_vectord),
    on_objects_out: wp.array(dtype=wp.spatial_vectord),
):
    """Set what contact exerts on both bodies in a step: their wrench less the gel's loss.

    The loss acts on the speeds at the step's end: v / (1 + step loss k mobility).
    """
    b = wp.tid()
    turn = wp.quat_to_matrix(wp.transform_get_rotation(pads.frames[b]))
    tip = wp.transform_get_translation(objects.frames[b])
    moved = wp.transpose(turn) * (velocity(objects, b, tip) - velocity(pads, b, tip))
    spun = wp.transpose(turn) * (objects.spins[b] - pads.spins[b])
    speeds = wp.spatial_vectord(moved[0], moved[1], moved[2], spun[0], spun[1], spun[2])
    moves = mobility(objects, b, tip, turn) + mobility(pads, b, tip, turn)
    a, cube = radii[b], radii[b] * radii[b] * radii[b]
    viscous = loss * wp.cw_mul(stiffness, wp.spatial_vectord(a, a, a, cube, cube, cube))
    lost, A = wp.cw_mul(viscous, speeds), wp.spatial_matrixd()
    for i in range(6):
        for j in range(6):
            A[i, j] = step * viscous[i] * moves[i, j] + wp.where(i == j, _ONE, _ZERO)
    for k in range(6):  # Gauss and Jordan: its leading minors are positive
        for i in range(6):
            if i != k:
                share = A[i, k] / A[k, k]
                lost[i] = lost[i] - share * lost[k]
                for j in range(6):
                    A[i, j] = A[i, j] - share * A[k, j]
    # Friction bounds what acts along the surface, and no contact pulls.
    mu, most = friction, wp.max(wrench[b, 2], _ZERO)
    mosts = most * wp.spatial_vectord(mu, mu, _ONE, a, a, mu * a)
    felt = wp.spatial_vectord()
    for i in range(6):
        felt[i] = wrench[b, i] - wp.clamp(lost[i] / A[i, i], -mosts[i], mosts[i])
    still = wp.length(wp.vec2d(wrench[b, 0], wrench[b, 1]))
    along = wp.length(wp.vec2d(felt[0], felt[1]))
    holds = wp.min(wp.max(mu * most, still) / wp.max(along, _NOTHING), _ONE)
    force = turn * wp.vec3d(holds * felt[0], holds * felt[1], felt[2])
    moment = turn * wp.vec3d(felt[3], felt[4], felt[5])
    on_objects_out[b] = felt_by(objects, b, tip, force, moment)
    on_pads_out[b] = felt_by(pads, b, tip, -force, -moment)


@wp.kernel(enable_backward=False)
def gather(
    # Model:
    numbers: wp.array(dtype=wp.int32),
    frame: wp.array(dtype=wp.transformd),  # of shape [1]
    centres: wp.array(dtype=wp.vec3),
    inverse_masses: wp.array(dtype=wp.float32),
    inverse_inertias: wp.array(dtype=wp.mat33),
    # Data in:
    poses: wp.array(dtype=wp.transform),
    speeds: wp.array(dtype=wp.spatial_vector),
    # Data out:
    out: Bodies,
):
    """Read some bodies of a newton state, with a frame that is fixed in them."""
    b = wp.tid()
    k = numbers[b]
    at = wp.vec3d(wp.transform_get_translation(poses[k]))
    given = wp.transform_get_rotation(poses[k])
    turned = wp.normalize(wp.quaternion(given, dtype=wp.float64))
    body, turn = wp.transformd(at, turned), wp.quat_to_matrix(turned)
    out.frames[b] = wp.transform_multiply(body, frame[0])
    out.centres[b] = wp.transform_point(body, wp.vec3d(centres[k]))
    out.velocities[b] = wp.vec3d(wp.spatial_top(speeds[k]))
    out.spins[b] = wp.vec3d(wp.spatial_bottom(speeds[k]))
    out.inverse_masses[b] = wp.float64(inverse_masses[k])
    out.inverse_inertias[b] = turn * wp.mat33d(inverse_inertias[k]) * wp.transpose(turn)


@wp.kernel(enable_backward=False)
def scatter(
    numbers: wp.array(dtype=wp.int32),
    loads: wp.array(dtype=wp.spatial_vectord),
    out: wp.array(dtype=wp.spatial_vector),
):
    """Add forces and moments to those of a newton state."""
    b = wp.tid()
    wp.atomic_add(out, numbers[b], wp.vector(loads[b], dtype=wp.float32))
