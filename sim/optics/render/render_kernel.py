"""Warp kernels of ``TactileRenderer``'s formula: one thread a pixel, or a ray, of a batch."""

# Device code: Warp compiles it, and Python type checkers do not speak its dialect.
# mypy: ignore-errors

from __future__ import annotations

import warp as wp

from sim.optics.render.photometric.polynomial import INDENTATION_UNIT_M
from sim.optics.render.shadows.horizon import NOTHING_M
from sim.warp_start import start_warp

start_warp()

MOST_POWERS = 8
Powers = wp.types.vector(length=MOST_POWERS, dtype=wp.float32)
SurfaceTerm = wp.types.vector(length=3, dtype=wp.int32)


@wp.func
def _powers(value: wp.float32) -> Powers:
    found = Powers()
    found[0] = wp.float32(1.0)
    for k in range(1, MOST_POWERS):
        found[k] = found[k - 1] * value
    return found


@wp.func
def _tilt(
    rest: wp.array2d(dtype=wp.float32),
    dent: wp.array3d(dtype=wp.float32),
    spacing: wp.vec2f,
    b: int,
    i: int,
    j: int,
) -> wp.vec2f:
    """Tilt by central differences, one-sided at the border."""
    up, down = wp.max(i - 1, 0), wp.min(i + 1, rest.shape[0] - 1)
    left, right = wp.max(j - 1, 0), wp.min(j + 1, rest.shape[1] - 1)
    along = (rest[i, right] - dent[b, i, right]) - (rest[i, left] - dent[b, i, left])
    across = (rest[down, j] - dent[b, down, j]) - (rest[up, j] - dent[b, up, j])
    p = along / (spacing[0] * wp.float32(right - left))
    q = across / (spacing[1] * wp.float32(down - up))
    return wp.vec2f(p, q) / wp.sqrt(wp.float32(1.0) + p * p + q * q)


@wp.func
def _softened(cosine: wp.float32, softness: wp.float32) -> wp.float32:
    """See ``shading_terms``."""
    return wp.float32(0.5) * (cosine + wp.sqrt(cosine * cosine + softness * softness))


@wp.func
def _lit(
    lamp: wp.vec3f,
    softness: wp.float32,
    tilt: wp.vec2f,
    u: wp.float32,
    v: wp.float32,
) -> wp.float32:
    """Light of a near lamp on a tilted surface less that on a level one."""
    way = wp.vec3f(lamp[0] - u, lamp[1] - v, lamp[2])
    away = wp.length(way)
    upright = wp.sqrt(wp.max(wp.float32(1.0) - wp.dot(tilt, tilt), wp.float32(0.0)))
    cosine = wp.dot(way, wp.vec3f(tilt[0], tilt[1], upright)) / away
    return _softened(cosine, softness) - _softened(way[2] / away, softness)


@wp.func
def _curvature(
    rest: wp.array2d(dtype=wp.float32),
    dent: wp.array3d(dtype=wp.float32),
    spacing: wp.vec2f,
    b: int,
    i: int,
    j: int,
) -> wp.float32:
    """Divergence of the tilt by central differences, one-sided at the border."""
    up, down = wp.max(i - 1, 0), wp.min(i + 1, rest.shape[0] - 1)
    left, right = wp.max(j - 1, 0), wp.min(j + 1, rest.shape[1] - 1)
    along = _tilt(rest, dent, spacing, b, i, right)[0] - _tilt(rest, dent, spacing, b, i, left)[0]
    across = _tilt(rest, dent, spacing, b, down, j)[1] - _tilt(rest, dent, spacing, b, up, j)[1]
    return along / (spacing[0] * wp.float32(right - left)) + across / (
        spacing[1] * wp.float32(down - up)
    )


@wp.kernel(enable_backward=False)
def shade_pixels(
    # Model:
    lamps: wp.array(dtype=wp.vec3f),
    softness: wp.float32,
    aspect: wp.float32,
    crease_limit: wp.float32,
    crease_unit: wp.float32,
    weights: wp.array2d(dtype=wp.vec3f),
    spacing: wp.vec2f,
    samples: wp.int32,
    rest: wp.array2d(dtype=wp.float32),
    # Data in:
    dent: wp.array3d(dtype=wp.float32),
    # Data out:
    change_out: wp.array3d(dtype=wp.vec3f),
):
    """Add near lamps and creases, the mean of each pixel's samples.

    ``weights`` has a row a lamp and one for creases, of level and gradients along u and v.
    """
    b, i, j = wp.tid()
    u = wp.float32(2 * j) / wp.float32(change_out.shape[2] - 1) - wp.float32(1.0)
    v = wp.float32(2 * i) / wp.float32(change_out.shape[1] - 1) - wp.float32(1.0)
    change = wp.vec3f()
    for k in range(weights.shape[0]):
        value = wp.float32(0.0)
        for s in range(samples * samples):
            row, column = i * samples + s / samples, j * samples + s % samples
            if k < lamps.shape[0]:
                tilt = _tilt(rest, dent, spacing, b, row, column)
                value += _lit(lamps[k], softness, tilt, u, v * aspect)
            else:
                bend = _curvature(rest, dent, spacing, b, row, column)
                value += crease_unit * wp.clamp(bend, -crease_limit, crease_limit)
        change += value * (weights[k, 0] + u * weights[k, 1] + v * weights[k, 2])
    change_out[b, i, j] = change_out[b, i, j] + change / wp.float32(samples * samples)


@wp.kernel(enable_backward=False)
def colour_pixels(
    # Model:
    surfaces: wp.array(dtype=SurfaceTerm),
    places: wp.array(dtype=wp.vec2i),
    weights: wp.array2d(dtype=wp.vec3f),
    tilt_limit: wp.float32,
    depth_limit: wp.float32,
    spacing: wp.vec2f,
    samples: wp.int32,
    rest: wp.array2d(dtype=wp.float32),
    # Data in:
    dent: wp.array3d(dtype=wp.float32),
    # Data out:
    change_out: wp.array3d(dtype=wp.vec3f),
):
    """Change of colour [grey levels], the mean of each pixel's samples, [batch, height, width]."""
    b, i, j = wp.tid()
    change = wp.vec3f()
    u = wp.float32(2 * j) / wp.float32(change_out.shape[2] - 1) - wp.float32(1.0)
    v = wp.float32(2 * i) / wp.float32(change_out.shape[1] - 1) - wp.float32(1.0)
    u_powers, v_powers = _powers(u), _powers(v)
    for s in range(samples * samples):
        row, column = i * samples + s / samples, j * samples + s % samples
        tilt = _tilt(rest, dent, spacing, b, row, column)
        size = wp.length(tilt)
        bound = wp.where(size > tilt_limit, tilt_limit / size, wp.float32(1.0))
        p_powers, q_powers = _powers(tilt[0] * bound), _powers(tilt[1] * bound)
        depth = wp.min(dent[b, row, column], depth_limit) / wp.float32(INDENTATION_UNIT_M)
        w_powers = _powers(depth)
        for k in range(surfaces.shape[0]):
            term = surfaces[k]
            here = wp.vec3f()
            for m in range(places.shape[0]):
                here += (u_powers[places[m][0]] * v_powers[places[m][1]]) * weights[m, k]
            change += (p_powers[term[0]] * q_powers[term[1]] * w_powers[term[2]]) * here
    change_out[b, i, j] = change / wp.float32(samples * samples)


@wp.kernel(enable_backward=False)
def sweep_rays(
    # Model:
    along_columns: wp.int32,
    forward: wp.int32,
    whole: wp.array(dtype=wp.int32),
    part: wp.array(dtype=wp.float32),
    sunk: wp.array(dtype=wp.float32),
    # Data in:
    dent: wp.array3d(dtype=wp.float32),
    # Data out:
    highest_out: wp.array3d(dtype=wp.float32),
):
    """Follow rays from the lamp; each step keeps the highest that was passed before it.

    One thread a ray of an image; ``highest_out`` has the shape [batch, step_count, ray_count or
    more]. See ``horizon.rise_over``.
    """
    b, ray = wp.tid()
    steps = whole.shape[0]
    across = wp.where(along_columns == 1, dent.shape[1], dent.shape[2])
    highest = wp.float32(NOTHING_M)
    for back in range(steps):
        k = steps - 1 - back
        highest_out[b, k, ray] = highest
        at = wp.where(forward == 1, k, steps - 1 - k)
        lower = wp.float32(0.0)
        upper = wp.float32(0.0)
        side = ray + whole[k]
        if side >= 0 and side < across:
            lower = wp.where(along_columns == 1, dent[b, side, at], dent[b, at, side])
        if side >= -1 and side + 1 < across:
            upper = wp.where(along_columns == 1, dent[b, side + 1, at], dent[b, at, side + 1])
        between = (wp.float32(1.0) - part[k]) * lower + part[k] * upper
        highest = wp.max(highest, between - sunk[k])


@wp.kernel(enable_backward=False)
def darken_pixels(
    # Model:
    along_columns: wp.int32,
    forward: wp.int32,
    whole: wp.array(dtype=wp.int32),
    part: wp.array(dtype=wp.float32),
    sunk: wp.array(dtype=wp.float32),
    towards: wp.vec3f,
    colour: wp.vec3f,
    softness: wp.float32,
    spacing: wp.vec2f,
    samples: wp.int32,
    rest: wp.array2d(dtype=wp.float32),
    # Data in:
    dent: wp.array3d(dtype=wp.float32),
    highest: wp.array3d(dtype=wp.float32),
    # Data out:
    change_out: wp.array3d(dtype=wp.vec3f),
):
    """Take away what is hidden of a lamp, in the mean of each pixel's samples."""
    b, i, j = wp.tid()
    lost = wp.float32(0.0)
    for s in range(samples * samples):
        row, column = i * samples + s / samples, j * samples + s % samples
        at = wp.where(along_columns == 1, column, row)
        side = wp.where(along_columns == 1, row, column)
        k = wp.where(forward == 1, at, whole.shape[0] - 1 - at)
        ray = side - whole[k]
        seen = part[k] * highest[b, k, ray - 1] + (wp.float32(1.0) - part[k]) * highest[b, k, ray]
        over = seen + sunk[k] - dent[b, row, column]
        hidden = wp.clamp(over / softness, wp.float32(0.0), wp.float32(1.0))
        tilt = _tilt(rest, dent, spacing, b, row, column)
        level = wp.sqrt(wp.float32(1.0) - wp.dot(tilt, tilt))
        facing = wp.dot(towards, wp.vec3f(tilt[0], tilt[1], level))
        lost += hidden * wp.max(facing, wp.float32(0.0))
    change_out[b, i, j] = change_out[b, i, j] - colour * (lost / wp.float32(samples * samples))


@wp.func
def _reflected(place: int, count: int) -> int:
    """The border's pixel is the mirror."""
    return wp.where(place < 0, -place, wp.where(place >= count, 2 * count - 2 - place, place))


@wp.kernel(enable_backward=False)
def blur_across(
    weights: wp.array(dtype=wp.float32),
    # Data in:
    change: wp.array3d(dtype=wp.vec3f),
    # Data out:
    blurred_out: wp.array3d(dtype=wp.vec3f),
):
    """Weigh neighbours along rows, [batch, height, width]."""
    b, i, j = wp.tid()
    middle = weights.shape[0] / 2
    total = wp.vec3f()
    for k in range(weights.shape[0]):
        total += weights[k] * change[b, i, _reflected(j + k - middle, change.shape[2])]
    blurred_out[b, i, j] = total


@wp.kernel(enable_backward=False)
def scale_pixels(
    gain: wp.array2d(dtype=wp.vec3f),
    # Data out:
    change_out: wp.array3d(dtype=wp.vec3f),
):
    """Multiply by what the no-contact frame is brighter than the model's reference."""
    b, i, j = wp.tid()
    change_out[b, i, j] = wp.cw_mul(gain[i, j], change_out[b, i, j])


@wp.kernel(enable_backward=False)
def expose_pixels(
    weights: wp.array(dtype=wp.float32),
    base: wp.array2d(dtype=wp.vec3f),
    knee: wp.float32,
    # Data in:
    change: wp.array3d(dtype=wp.vec3f),
    # Data out:
    image_out: wp.array4d(dtype=wp.uint8),
):
    """Weigh neighbours along columns, add what does not change, compress and round."""
    b, i, j = wp.tid()
    middle = weights.shape[0] / 2
    level = base[i, j]
    for k in range(weights.shape[0]):
        level += weights[k] * change[b, _reflected(i + k - middle, change.shape[1]), j]
    for channel in range(3):
        shown = level[channel]
        room = wp.float32(255.0) - knee
        if shown > knee and room > wp.float32(0.0):
            shown = knee + room * (wp.float32(1.0) - wp.exp((knee - shown) / room))
        bounded = wp.clamp(shown + wp.float32(0.5), wp.float32(0.0), wp.float32(255.0))
        image_out[b, i, j, channel] = wp.uint8(bounded)
