"""Warp kernel of the photometric model: one thread a pixel of a batch."""

# Device code: Warp compiles it, and Python type checkers do not speak its dialect.
# mypy: ignore-errors

from __future__ import annotations

import warp as wp

from sim.optics.polynomial import INDENTATION_UNIT_M
from sim.warp_start import start_warp

start_warp()

MOST_POWERS = 8
Powers = wp.types.vector(length=MOST_POWERS, dtype=wp.float32)
Term = wp.types.vector(length=5, dtype=wp.int32)


@wp.func
def _powers(value: wp.float32) -> Powers:
    found = Powers()
    found[0] = wp.float32(1.0)
    for k in range(1, MOST_POWERS):
        found[k] = found[k - 1] * value
    return found


@wp.kernel(enable_backward=False)
def render_images(
    # Model:
    terms: wp.array(dtype=Term),
    coefficients: wp.array(dtype=wp.vec3f),
    tilt_limit: wp.float32,
    depth_limit: wp.float32,
    spacing: wp.vec2f,
    rest: wp.array2d(dtype=wp.float32),
    base: wp.array2d(dtype=wp.vec3f),
    # Data in:
    dent: wp.array3d(dtype=wp.float32),
    # Data out:
    image_out: wp.array4d(dtype=wp.uint8),
):
    """Tilt by central differences, bounded; the polynomial; rounding; shape as ``dent``, and 3."""
    b, i, j = wp.tid()
    height, width = rest.shape[0], rest.shape[1]
    up, down = wp.max(i - 1, 0), wp.min(i + 1, height - 1)
    left, right = wp.max(j - 1, 0), wp.min(j + 1, width - 1)
    along = (rest[i, right] - dent[b, i, right]) - (rest[i, left] - dent[b, i, left])
    across = (rest[down, j] - dent[b, down, j]) - (rest[up, j] - dent[b, up, j])
    p = along / (spacing[0] * wp.float32(right - left))
    q = across / (spacing[1] * wp.float32(down - up))
    steepness = wp.sqrt(wp.float32(1.0) + p * p + q * q)
    p, q = p / steepness, q / steepness
    tilt = wp.sqrt(p * p + q * q)
    bound = wp.where(tilt > tilt_limit, tilt_limit / tilt, wp.float32(1.0))
    p_powers, q_powers = _powers(p * bound), _powers(q * bound)
    w_powers = _powers(wp.min(dent[b, i, j], depth_limit) / wp.float32(INDENTATION_UNIT_M))
    u_powers = _powers(wp.float32(2 * j) / wp.float32(width - 1) - wp.float32(1.0))
    v_powers = _powers(wp.float32(2 * i) / wp.float32(height - 1) - wp.float32(1.0))
    level = base[i, j]
    for k in range(terms.shape[0]):
        term = terms[k]
        place = u_powers[term[2]] * v_powers[term[3]]
        level += (p_powers[term[0]] * q_powers[term[1]] * w_powers[term[4]] * place) * coefficients[
            k
        ]
    for channel in range(3):
        bounded = wp.clamp(level[channel] + wp.float32(0.5), wp.float32(0.0), wp.float32(255.0))
        image_out[b, i, j, channel] = wp.uint8(bounded)
