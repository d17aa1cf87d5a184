"""Warp kernel from changes of light to the bytes of one image, a block of pixels at a time."""

# Device code: Warp compiles it, and Python type checkers do not speak its dialect.
# mypy: ignore-errors

from __future__ import annotations

import warp as wp

from sim.optics.render.pixel_kernel import BLOCK_FLAGS, LANES, Block, ByteBlock

wp.set_module_options({"cpu_compiler_flags": BLOCK_FLAGS})


@wp.func
def _reflected(place: int, count: int) -> int:
    """The border's pixel is the mirror."""
    return wp.where(place < 0, -place, wp.where(place >= count, 2 * count - 2 - place, place))


@wp.func
def _compressed(levels: Block, knee: wp.float32) -> Block:
    """Return light as the camera shows it, see ``response``."""
    shown = Block()
    room = wp.float32(255.0) - knee
    for n in range(LANES):
        shown[n] = levels[n]
        if levels[n] > knee:
            shown[n] = knee + room * (wp.float32(1.0) - wp.exp((knee - levels[n]) / room))
    return shown


@wp.kernel(enable_backward=False)
def expose_rows(
    blocks: wp.int32,
    columns: wp.int32,
    start: wp.int32,
    knee: wp.float32,
    weights: wp.array(dtype=wp.float32),
    base: wp.array2d(dtype=Block),
    # Data in:
    change: wp.array2d(dtype=Block),
    # Scratch:
    row_single: wp.array(dtype=wp.float32),
    row_blocks: wp.array(dtype=Block),
    row_shifted: wp.array2d(dtype=Block),
    # Data out:
    image_out: wp.array2d(dtype=ByteBlock),
):
    """Weigh neighbours along columns and rows, add what does not change, compress and round."""
    i = wp.tid() + start
    reach = weights.shape[0] / 2
    rows = change.shape[1] / (blocks + 2)
    for channel in range(3):
        for k in range(blocks):
            total = Block()
            for d in range(weights.shape[0]):
                row = _reflected(i + d - reach, rows)
                total += weights[d] * change[channel, row * (blocks + 2) + 1 + k]
            row_blocks[1 + k] = total
        for d in range(1, reach + 1):
            row_single[LANES - d] = row_single[LANES + d]
            row_single[LANES + columns - 1 + d] = row_single[LANES + columns - 1 - d]
        for k in range(blocks):
            levels = base[channel, i * blocks + k]
            for d in range(weights.shape[0]):
                levels += weights[d] * row_shifted[d, 1 + k]
            exposed = ByteBlock()
            if wp.max(levels) > knee and knee < wp.float32(255.0):
                levels = _compressed(levels, knee)
            for n in range(LANES):
                bounded = wp.clamp(levels[n] + wp.float32(0.5), wp.float32(0.0), wp.float32(255.0))
                exposed[n] = wp.uint8(bounded)
            image_out[channel, i * blocks + k] = exposed
