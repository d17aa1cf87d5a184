"""Warp kernels on one image's samples, a block of pixels of a row at a time.

Whole blocks are added and multiplied, so that an instruction of the processor works on many pixels.
A plane has ``pitch`` blocks for each row of pixels: those of the image and one of room at each end.
A sample (a, b) of a pixel lies in a plane of its own, the ``a * samples + b``-th. Where an array
has two indices, the first says by how many pixels the block lies further right, less those of room.
"""

# Device code: Warp compiles it, and Python type checkers do not speak its dialect.
# mypy: ignore-errors

from __future__ import annotations

import warp as wp

from sim.warp_start import start_warp

start_warp()

LANES = 16
ROOM_ROWS = 2
Block = wp.types.vector(length=LANES, dtype=wp.float32)
ByteBlock = wp.types.vector(length=LANES, dtype=wp.uint8)
# Warp's own flags keep the compiler from putting a whole block into an instruction.
BLOCK_FLAGS = (
    "-march=native -ffp-contract=fast -mllvm=-inline-threshold=9000"
    " -mllvm=-slp-recursion-max-depth=12"
)
wp.set_module_options({"cpu_compiler_flags": BLOCK_FLAGS})


@wp.struct
class Band:
    """A band of rows of pixels, and where its samples lie."""

    rows: wp.int32  # of the image
    blocks: wp.int32  # of pixels in a row
    plane: wp.int32  # blocks of it
    samples: wp.int32
    first: wp.int32  # row of the image
    half_per_x: wp.float32  # over twice the spacing of samples [1/m]
    per_y: wp.float32  # over the spacing [1/m]


@wp.func
def place_of(band: Band, row: int, block: int) -> int:
    """Return where a block of the first samples of a row of pixels lies."""
    return (row - band.first + ROOM_ROWS) * (band.blocks + 2) + 1 + block


@wp.func
def _above(band: Band, row: int, a: int, at: int) -> int:
    """Return where the samples above those at a place lie; the border's are themselves."""
    if a > 0:
        return at - band.samples * band.plane
    if row > 0:
        return at + (band.samples - 1) * band.samples * band.plane - (band.blocks + 2)
    return at


@wp.func
def _below(band: Band, row: int, a: int, at: int) -> int:
    """Return where the samples below lie."""
    if a < band.samples - 1:
        return at + band.samples * band.plane
    if row < band.rows - 1:
        return at - (band.samples - 1) * band.samples * band.plane + (band.blocks + 2)
    return at


@wp.func
def _per_distance(band: Band, row: int, a: int) -> wp.float32:
    """Return one over the distance between the samples above and below [1/m]."""
    if row == 0 and a == 0:
        return band.per_y
    if row == band.rows - 1 and a == band.samples - 1:
        return band.per_y
    return wp.float32(0.5) * band.per_y


@wp.func
def _across_row(band: Band, planes: wp.array2d(dtype=Block), at: int, b: int) -> Block:
    """Return the samples right of a block of the ``b``-th samples less those left of it."""
    wrap = (band.samples - 1) * band.plane
    first, last = b == 0, b == band.samples - 1
    left = planes[wp.where(first, 0, 1), wp.where(first, at + wrap, at - band.plane)]
    right = planes[wp.where(last, 2, 1), wp.where(last, at - wrap, at + band.plane)]
    return right - left


@wp.kernel(enable_backward=False)
def continue_rows(
    band: Band,
    columns: wp.int32,
    start: wp.int32,
    # Data in and out:
    planes: wp.array(dtype=wp.float32),
):
    """Go on linearly by a sample at both ends of rows: differences are one-sided there."""
    row = start + wp.tid()
    plane = LANES * band.plane
    for a in range(band.samples):
        first = LANES * place_of(band, row, 0) + a * band.samples * plane
        end = first + (band.samples - 1) * plane + columns - 1
        after, before = first + 1, end - 1
        if band.samples > 1:
            after, before = first + plane, end - plane
        planes[first - 1 + (band.samples - 1) * plane] = (
            wp.float32(2.0) * planes[first] - planes[after]
        )
        planes[first + columns] = wp.float32(2.0) * planes[end] - planes[before]


@wp.kernel(enable_backward=False)
def tilt_samples(
    band: Band,
    start: wp.int32,
    rest: wp.array(dtype=Block),
    # Data in:
    height: wp.array2d(dtype=Block),
    # Data out:
    along_out: wp.array(dtype=Block),
    across_out: wp.array(dtype=Block),
    dent_out: wp.array(dtype=Block),
):
    """Tilt by central differences, one-sided at the border, and indentation, from a row on."""
    t = wp.tid()
    i = t / band.blocks
    k = t - i * band.blocks
    row = start + i
    for a in range(band.samples):
        per_y = _per_distance(band, row, a)
        for b in range(band.samples):
            at = place_of(band, row, k) + (a * band.samples + b) * band.plane
            p = _across_row(band, height, at, b) * band.half_per_x
            q = (height[1, _below(band, row, a, at)] - height[1, _above(band, row, a, at)]) * per_y
            scale = wp.cw_mul(p, p) + wp.cw_mul(q, q)
            for n in range(LANES):
                scale[n] = wp.float32(1.0) / wp.sqrt(wp.float32(1.0) + scale[n])
            along_out[at] = wp.cw_mul(p, scale)
            across_out[at] = wp.cw_mul(q, scale)
            dent_out[at] = rest[at] - height[1, at]


@wp.func
def bend_of(
    band: Band,
    along: wp.array2d(dtype=Block),
    across: wp.array(dtype=Block),
    row: int,
    a: int,
    b: int,
    at: int,
) -> Block:
    """Divergence of the tilt by central differences, one-sided at the border."""
    p = _across_row(band, along, at, b) * band.half_per_x
    q = across[_below(band, row, a, at)] - across[_above(band, row, a, at)]
    return p + q * _per_distance(band, row, a)
