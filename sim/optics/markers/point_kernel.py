"""Warp kernels of points on gels' surfaces: where they are carried, and where they are seen."""

from __future__ import annotations

import warp as wp


@wp.kernel(enable_backward=False)
def carry_points(
    # Model:
    nodes: wp.array2d(dtype=wp.int32),
    signs: wp.array2d(dtype=wp.vec3d),
    rest: wp.array2d(dtype=wp.vec3d),
    weights: wp.array(dtype=wp.vec3d),
    # Data in:
    positions: wp.array2d(dtype=wp.vec3d),
    # Data out:
    moved_out: wp.array2d(dtype=wp.vec3d),
):
    """Weigh the displacement of the corners of each point's facet."""
    env, i = wp.tid()
    moved = wp.vec3d()
    for c in range(3):
        at = wp.cw_mul(positions[env, nodes[i, c]], signs[i, c])
        moved += weights[i][c] * (at - rest[i, c])
    moved_out[env, i] = moved


@wp.kernel(enable_backward=False)
def see_points(
    rest_px: wp.array(dtype=wp.vec2d),
    back: wp.mat22d,
    # Data in:
    moved: wp.array2d(dtype=wp.vec3d),
    # Data out:
    pixel_out: wp.array3d(dtype=wp.float32),
):
    """Project points that moved."""
    env, i = wp.tid()
    pixel = rest_px[i] + back * wp.vec2d(moved[env, i][0], moved[env, i][1])
    for axis in range(2):
        pixel_out[env, i, axis] = wp.float32(pixel[axis])
