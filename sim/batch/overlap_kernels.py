"""Warp kernel: what indenters overlap of the resting gel, which gives the force of light contacts.

A light contact touches so few points that its force on the mesh depends on where they lie. The
overlap of the body, with its own edges, and the resting gel predicts it better. With pressure like
the overlap's depth g along z (Ritz's method on a half-space), stiffened by the base of gel that is
z high there,

    F_light = 3.2 E / (1 - nu^2) mean(g) r exp(2.73 q / z)

with means weighted by g, r = (sqrt r_1 + sqrt r_2)^2 / 4 and q = sqrt(r_1 r_2) of the standard
deviations r_1 and r_2 along the overlap's axes: the base stiffens a long overlap less. The
logarithm of F is that of F_light by a share of exp(-(s / (0.5 h))^4 - (mean(g) / (0.9 r))^4), with
h the gap within which a point's face may touch and s = 2 r_1 r_2 / (r_1 + r_2). Where the share
is 0.3 or more F_light is within 5 % of presses on fine meshes, in 55 of 57 drawn on two sensors.
"""

import warp as wp

from sim.contact.barrier_and_friction_kernels import FAR_M
from sim.contact.indenter_distance import Body, Poses, nearby_gap, posed
from sim.scene.triangle_distance import hit_below

THREADS = 512
"""Of a block on a GPU."""

# Samples along a side of the grid over an overlap, and how often it is laid: it closes in.
_SIDE, _SAMPLES, _LOOKS = wp.constant(32), wp.constant(32 * 32), wp.constant(3)
_CELL = wp.constant(wp.float64(1.0 / 32.0))
# Of a light contact: F over E / (1 - nu^2) mean(g) r, how the base stiffens it, s over ``reach``
# and mean depth over r where its share is 1 / e.
_FORCE, _NEAR_BASE = wp.constant(wp.float64(3.2)), wp.constant(wp.float64(2.73))
_LIGHT, _STEEP = wp.constant(wp.float64(0.5)), wp.constant(wp.float64(0.9))
# Of the pad's height: mean overlap from which errors of F_z grow.
_DEEP_FROM = wp.constant(wp.float64(0.25))
# A round body is met from below: along tangents, which pass through no convex body; one of
# triangles need not be convex, and is met by the gap itself.
_RISES, _MET_M = wp.constant(30), wp.constant(wp.float64(1e-9))
_FLATTEST = wp.constant(wp.float64(1e-3))
_Sums = wp.types.vector(length=8, dtype=wp.float64)


@wp.struct
class Resting:
    """The resting gel: its height is ``height`` - x^2 ``bend_x`` - y^2 ``bend_y``."""

    height: wp.float64  # [m]
    bend_x: wp.float64  # [1/m]
    bend_y: wp.float64
    half_x: wp.float64  # half the pad's size [m]
    half_y: wp.float64


@wp.func
def _depth(body: Body, x: wp.vec3d) -> wp.float64:
    """Return how far a point lies above a body's underside [m], zero or less outside."""
    zero = wp.float64(0.0)
    depth = zero
    down = wp.transpose(body.rotation) * wp.vec3d(zero, zero, wp.float64(-1.0))
    if body.is_mesh and body.surface.rounding == zero:
        p = wp.transpose(body.rotation) * (x - body.position)
        depth = hit_below(body.surface, p, down)
    else:
        gap, n = nearby_gap(body, x, FAR_M)
        if gap < zero:
            # Below all of the body, however it is tilted.
            wide = body.radius + wp.float64(2.0) * wp.length(body.surface.half)
            low = wide * wp.sqrt(down[0] * down[0] + down[1] * down[1])
            at = wp.vec3d(x[0], x[1], body.position[2] - low - _MET_M)
            for _ in range(_RISES):
                gap, n = nearby_gap(body, at, FAR_M)
                if gap < _MET_M or at[2] > x[2]:
                    break
                at[2] += wp.where(body.is_mesh, gap, gap / wp.max(-n[2], _FLATTEST))
            depth = x[2] - at[2]
    return depth


@wp.kernel(enable_backward=False, launch_bounds=THREADS)
def overlap(
    # Model:
    bodies: wp.array(dtype=Body),
    resting: Resting,
    standoff: wp.float64,
    reach: wp.float64,
    moduli: wp.array(dtype=wp.float64),
    # Data in:
    wanted: wp.array(dtype=wp.int32),
    poses: Poses,
    touched: wp.array2d(dtype=wp.float64),
    # Data out:
    light_out: wp.array(dtype=wp.vec3d),
):
    """Give F_light [N], its share, and the mean overlap beyond a quarter of the pad's height.

    The last is relative to that height. Launches over [environment_count, threads of a block].
    ``moduli`` are E / (1 - nu^2) [Pa], zero where F_light is not known. ``touched`` has at 9 to 12
    how far contact may reach from the tip along x, -x, y and -y [m]. Contact begins within
    ``reach`` [m]; poses hold tips ``standoff`` higher than the bodies are [m].
    """
    b, thread = wp.tid()
    if wanted[b] == 0:
        return
    zero, half = wp.float64(0.0), wp.float64(0.5)
    body = posed(bodies, poses, b)
    body.position = body.position - wp.vec3d(zero, zero, standoff)
    # Along x, -x, y and -y.
    ends = wp.vec4d(touched[b, 9], touched[b, 10], touched[b, 11], touched[b, 12])
    sums = _Sums()
    for look in range(_LOOKS):
        step_x, step_y = (ends[0] + ends[1]) * _CELL, (ends[2] + ends[3]) * _CELL
        most = wp.vec4d(-FAR_M, -FAR_M, -FAR_M, -FAR_M)
        samples = wp.where(step_x < zero, 0, _SAMPLES)
        for p in range(thread, samples, wp.block_dim()):
            x = (wp.float64(p % _SIDE) + half) * step_x - ends[1]
            y = (wp.float64(p // _SIDE) + half) * step_y - ends[3]
            at_x, at_y = x + body.position[0], y + body.position[1]
            z = resting.height - at_x * at_x * resting.bend_x - at_y * at_y * resting.bend_y
            if wp.abs(at_x) < resting.half_x and wp.abs(at_y) < resting.half_y:
                g = _depth(body, wp.vec3d(at_x, at_y, z))
                if g > zero:
                    most = wp.max(most, wp.vec4d(x, -x, y, -y))
                    if look == _LOOKS - 1:
                        sums += g * _Sums(wp.float64(1.0), g, x, y, z, x * x, y * y, x * y)
        if look < _LOOKS - 1:
            farthest = wp.tile_reduce(wp.max, wp.tile(most, preserve_type=True))
            ends = farthest[0] + wp.vec4d(step_x, step_x, step_y, step_y)
    all_sums = wp.tile_sum(wp.tile(sums, preserve_type=True))
    sums = all_sums[0]
    if thread == 0:
        light_out[b] = wp.vec3d()
        if sums[0] > zero and moduli[b] > zero:
            depth, height = sums[1] / sums[0], sums[4] / sums[0]
            x, y = sums[2] / sums[0], sums[3] / sums[0]
            xx, yy = sums[5] / sums[0] - x * x, sums[6] / sums[0] - y * y
            xy = sums[7] / sums[0] - x * y
            both = wp.sqrt(wp.max(xx * yy - xy * xy, zero))
            across, along = wp.sqrt(both), wp.sqrt(xx + yy + both + both)
            radius = half * (half * along + across)
            force = _FORCE * moduli[b] * depth * radius * wp.exp(_NEAR_BASE * across / height)
            if radius > zero:
                fades = wp.pow(both / (half * along * _LIGHT * reach), wp.float64(4.0))
                fades += wp.pow(depth / (_STEEP * radius), wp.float64(4.0))
                light_out[b] = wp.vec3d(
                    force, wp.exp(-fades), wp.max(depth / height - _DEEP_FROM, zero)
                )
