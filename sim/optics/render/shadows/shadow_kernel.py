"""Warp kernels of shadows on a processor: rays of a sweep, then pixels, a block at a time."""

# Device code: Warp compiles it, and Python type checkers do not speak its dialect.
# mypy: ignore-errors

from __future__ import annotations

import warp as wp

from sim.optics.render.pixel_kernel import BLOCK_FLAGS, LANES, Band, Block, place_of
from sim.optics.render.shadows.horizon import NOTHING_M

wp.set_module_options({"cpu_compiler_flags": BLOCK_FLAGS})


@wp.struct
class Rays:
    """How a lamp's rays go over rows of values with ``room`` beside them, see ``horizon``."""

    forward: wp.int32
    blocks: wp.int32  # of values across
    ray_blocks: wp.int32
    room: wp.int32  # values at each end of a row
    pitch: wp.int32  # blocks of a row with its room
    whole: wp.array(dtype=wp.int32)
    part: wp.array(dtype=wp.float32)
    sunk: wp.array(dtype=wp.float32)
    per_softness: wp.float32


@wp.kernel(enable_backward=False)
def hide_pixels(
    rays: Rays,
    # Data in:
    dent: wp.array2d(dtype=Block),
    # Scratch:
    highest: wp.array(dtype=Block),
    highest_shifted: wp.array2d(dtype=Block),
    # Data out:
    hidden_out: wp.array2d(dtype=Block),
):
    """Follow all rays from the lamp on, and say how much of it is hidden from the values passed.

    In arrays with two indices the first says by how many values a block lies further on.
    """
    for n in range(rays.ray_blocks + 2):
        highest[n] = Block(wp.float32(NOTHING_M))
    steps = rays.whole.shape[0]
    for back in range(steps):
        k = steps - 1 - back
        at = wp.where(rays.forward == 1, k, back)
        whole, part, sunk = rays.whole[k], rays.part[k], rays.sunk[k]
        rest = wp.float32(1.0) - part
        # The value at y lies between the rays y - whole - 1 and y - whole.
        ray = LANES - whole - 1
        block, lane = ray / LANES, ray % LANES
        row = at * rays.pitch + rays.room / LANES
        for n in range(rays.blocks):
            before, after = highest_shifted[lane, block + n], highest_shifted[lane + 1, block + n]
            over = part * before + rest * after + Block(sunk) - dent[0, row + n]
            share = over * rays.per_softness
            hidden_out[at, n] = wp.min(
                wp.max(share, Block(wp.float32(0.0))), Block(wp.float32(1.0))
            )
        # A ray passes between the values at its number plus whole and the next.
        value = rays.room + whole
        block, lane = value / LANES, value % LANES
        row = at * rays.pitch + block
        for n in range(rays.ray_blocks):
            passed = rest * dent[lane, row + n] + part * dent[lane + 1, row + n] - Block(sunk)
            highest[1 + n] = wp.max(highest[1 + n], passed)


@wp.kernel(enable_backward=False)
def darken_blocks(
    band: Band,
    towards: wp.vec3f,
    colour: wp.vec3f,
    plane: wp.int32,
    # Data in:
    along: wp.array2d(dtype=Block),
    across: wp.array(dtype=Block),
    hidden: wp.array(dtype=Block),
    # Data out:
    change_out: wp.array2d(dtype=Block),
):
    """Take away what is hidden of a lamp, in the mean of each pixel's samples."""
    t = wp.tid()
    i = t / band.blocks
    k = t - i * band.blocks
    row = band.first + i
    lost = Block()
    at = place_of(band, row, k)
    to = row * (band.blocks + 2) + 1 + k
    for s in range(band.samples * band.samples):
        p, q = along[1, at], across[at]
        upright = wp.cw_mul(p, p) + wp.cw_mul(q, q)
        for n in range(LANES):
            upright[n] = wp.sqrt(wp.max(wp.float32(1.0) - upright[n], wp.float32(0.0)))
        facing = towards[0] * p + towards[1] * q + towards[2] * upright
        facing = wp.max(facing, Block(wp.float32(0.0)))
        lost += wp.cw_mul(hidden[to + s * plane], facing)
        at += band.plane
    lost = lost * (wp.float32(1.0) / wp.float32(band.samples * band.samples))
    for channel in range(3):
        change_out[channel, to] = change_out[channel, to] - colour[channel] * lost
