"""Warp kernels of points on gels' surfaces: where they are carried, and where they are seen."""

from typing import Any

import warp as wp

from sim.device import native_code


@wp.struct
class Points:
    """Points of the gel, how they hang on a model's nodes, and how they are seen."""

    nodes: wp.array2d(dtype=wp.int32)  # at the corners of the facet that each lies on, shape [n, 3]
    signs: wp.array2d(dtype=wp.vec3d)  # of those nodes' coordinates
    rest: wp.array2d(dtype=wp.vec3d)  # the corners at rest [m]
    weights: wp.array(dtype=wp.vec3d)  # of the corners, shape [n]
    rest_px: wp.array(dtype=wp.vec2d)  # where the points are seen at rest
    back: wp.mat22d  # pixels for a pad step [px/m]
    middle: wp.vec2d  # column and row of the camera's axis [px]
    per_distance: wp.float64  # one over the pinhole's distance from the gel [1/m]


@wp.kernel(enable_backward=False)
def see_points(
    points: Points, positions: wp.array2d(dtype=wp.vec3d), pixel_out: wp.array3d(dtype=wp.float32)
):
    """Project points that moved; what comes nearer to the camera moves away from its axis."""
    env, i = wp.tid()
    by = wp.vec3d()
    for c in range(3):
        at = wp.cw_mul(positions[env, points.nodes[i, c]], points.signs[i, c])
        by += points.weights[i][c] * (at - points.rest[i, c])
    pixel = points.rest_px[i] + points.back * wp.vec2d(by[0], by[1])
    nearer = -by[2] * points.per_distance
    pixel += (pixel - points.middle) * (nearer / (wp.float64(1.0) - nearer))
    for axis in range(2):
        pixel_out[env, i, axis] = wp.float32(pixel[axis])


_ROUNDS = wp.constant(4)
_SETTLED_PX2 = wp.constant(wp.float32(1.0e-8))  # a millionth of a marker's radius, squared


@wp.func
def _between(values: wp.array2d(dtype=Any), x: wp.float32, y: wp.float32):
    """Interpolate linearly at a column and row of an array, bounded by its border."""
    x = wp.clamp(x, wp.float32(0.0), wp.float32(values.shape[1] - 1))
    y = wp.clamp(y, wp.float32(0.0), wp.float32(values.shape[0] - 1))
    left, top = wp.min(int(x), values.shape[1] - 2), wp.min(int(y), values.shape[0] - 2)
    u, v = x - wp.float32(left), y - wp.float32(top)
    upper = values[top, left] * (wp.float32(1.0) - u) + values[top, left + 1] * u
    lower = values[top + 1, left] * (wp.float32(1.0) - u) + values[top + 1, left + 1] * u
    return upper * (wp.float32(1.0) - v) + lower * v


@wp.kernel(enable_backward=False)
def motion_of(
    spacing: wp.float32, seen: wp.array3d(dtype=wp.float32), moved_out: wp.array3d(dtype=wp.vec2f)
):
    """Take a lattice's places at rest from where its points are seen [px]."""
    env, i, j = wp.tid()
    at = i * moved_out.shape[2] + j
    moved_out[env, i, j] = wp.vec2f(
        seen[env, at, 0] - spacing * wp.float32(j), seen[env, at, 1] - spacing * wp.float32(i)
    )


@wp.kernel(enable_backward=False)
def came_from(
    spacing: wp.float32, moved: wp.array3d(dtype=wp.vec2f), motion_out: wp.array3d(dtype=wp.vec2f)
):
    """Turn the motion of gel from points of a lattice into that of the gel now seen there [px]."""
    env, i, j = wp.tid()
    x, y = wp.float32(j), wp.float32(i)
    by = moved[env, i, j]
    for _ in range(_ROUNDS):
        if wp.isfinite(by[0] + by[1]):
            before = by
            by = _between(moved[env], x - by[0] / spacing, y - by[1] / spacing)
            if wp.length_sq(by - before) < _SETTLED_PX2:
                break
    motion_out[env, i, j] = by


@wp.func_native(native_code(__package__, "print"))
def _print(
    spacing: int,
    env: int,
    i: int,
    j: int,
    corner: wp.vec2f,
    right: wp.vec2f,
    below: wp.vec2f,
    opposite: wp.vec2f,
    fine: wp.float32,
    dark: wp.vec3f,
    ink: wp.array2d(dtype=wp.vec4f),
    touched: wp.array2d(dtype=wp.uint8),
    image: wp.array4d(dtype=wp.uint8),
): ...


@wp.kernel(enable_backward=False)
def print_ink(
    spacing: wp.int32,
    fine: wp.float32,
    dark: wp.vec3f,
    ink: wp.array2d(dtype=wp.vec4f),
    inked: wp.array2d(dtype=wp.uint8),
    touched: wp.array2d(dtype=wp.uint8),
    # Data in:
    motion: wp.array3d(dtype=wp.vec2f),
    # Data in and out:
    image: wp.array4d(dtype=wp.uint8),
):
    """Print markers over a cell of the lattice of images of bare gel: see ``PrintedMarkers``.

    The ink has ``fine`` samples a pixel. ``inked`` is 1 for cells that have ink or a neighbour with
    ink, and ``touched`` for such pixels; what comes from others is bare.
    """
    env, i, j = wp.tid()
    corner, right = motion[env, i, j], motion[env, i, j + 1]
    below, opposite = motion[env, i + 1, j], motion[env, i + 1, j + 1]
    middle = (corner + right + below + opposite) * wp.float32(0.25)
    if not wp.isfinite(middle[0] + middle[1]):
        return
    step = wp.float32(spacing)
    from_row = int(wp.floor(wp.float32(i) + wp.float32(0.5) - middle[1] / step))
    from_column = int(wp.floor(wp.float32(j) + wp.float32(0.5) - middle[0] / step))
    from_row = wp.clamp(from_row, 0, inked.shape[0] - 1)
    from_column = wp.clamp(from_column, 0, inked.shape[1] - 1)
    if inked[from_row, from_column] == wp.uint8(0):
        return
    _print(spacing, env, i, j, corner, right, below, opposite, fine, dark, ink, touched, image)
