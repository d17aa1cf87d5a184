"""Warp kernels that make the dense inverse of the undeformed gel's stiffness.

Blocks of pivots are swept one after the other (Goodnight 1979), each a product of two narrow
matrices, of which the lower triangle is enough.
"""

# Annotations are evaluated where they stand, since native functions have no body to look them up.
import warp as wp

from sim.device import native_code
from sim.solve.descent_state import Act, Descent

BLOCK = 64
"""Pivots that are swept at once."""

_WIDE = wp.constant(BLOCK)


@wp.kernel(enable_backward=False)
def spread(
    rows: wp.array(dtype=wp.int32),
    columns: wp.array(dtype=wp.int32),
    values: wp.array(dtype=wp.float32),
    matrix: wp.array2d(dtype=wp.float32),
):
    """Put an upper triangle's values to both sides of the diagonal; launches over the values."""
    k = wp.tid()
    matrix[rows[k], columns[k]] = values[k]
    matrix[columns[k], rows[k]] = values[k]


@wp.kernel(enable_backward=False)
def block_at(
    inverse: wp.array2d(dtype=wp.float32),
    rows: wp.array(dtype=wp.int32),
    block: wp.array2d(dtype=wp.float32),
):
    """Gather rows and columns, zero where they are negative; launches over the block."""
    i, j = wp.tid()
    if rows[i] >= 0 and rows[j] >= 0:
        block[i, j] = inverse[rows[i], rows[j]]


@wp.kernel(enable_backward=False)
def diagonal_of(matrix: wp.array2d(dtype=wp.float32), diagonal: wp.array(dtype=wp.float32)):
    """Copy the diagonal; launches over its entries."""
    i = wp.tid()
    diagonal[i] = matrix[i, i]


@wp.kernel(enable_backward=False)
def pack(
    matrix: wp.array2d(dtype=wp.float32),
    size: wp.int32,
    steps: wp.int32,
    scale: wp.float32,
    weights: wp.array(dtype=wp.float32),
    order: wp.array(dtype=wp.int32),
    packed: wp.array2d(dtype=wp.float16),
):
    """Order a matrix as the lanes of a warp take it: by row tile, step, half, lane and place.

    Rows are taken in the given order.
    """
    tile, step, place = wp.tid()
    half = place / 256
    group = place / 32 % 8
    member = place / 8 % 4
    row = order[16 * tile + 8 * (place / 2 % 2) + group]
    column = 32 * step + 8 * member + 4 * half + 2 * (place / 4 % 2) + place % 2
    if row < size and column < size:
        at = (tile * steps + step) * 512 + place
        entry = matrix[row, column] * scale / (weights[row] * weights[column])
        packed[0, at] = wp.float16(entry)


@wp.kernel(enable_backward=False)
def place(
    d: Descent,
    width: wp.int32,
    few_most: wp.int32,
    blocks: wp.array(dtype=wp.int32),
    few: wp.array(dtype=wp.int32),
):
    """Give who asks the first columns, and blocks without any no matrix; one block of threads.

    ``few`` is the one block of narrow products, which serve so many columns at most.
    """
    thread = wp.tid()
    total = wp.int32(0)
    for first in range(0, d.slot.shape[0], wp.block_dim()):
        b = first + thread
        asks = wp.int32(0)
        if b < d.slot.shape[0] and d.act[b] == Act.SOLVE:
            asks = 1
        places = wp.tile_scan_inclusive(wp.tile(asks))
        if asks == 1:
            d.slot[b] = total + places[thread] - 1
        total += places[wp.block_dim() - 1]
    if thread == 0:
        few[0] = wp.where(total <= few_most, 0, -1)
    for k in range(thread, blocks.shape[0], wp.block_dim()):
        blocks[k] = wp.where(k * width < total and total > few_most, 0, -1)


@wp.kernel(enable_backward=False)
def negate(matrix: wp.array2d(dtype=wp.float32)):
    """Change the signs of the lower triangle, and mirror it; launches over the matrix."""
    i, j = wp.tid()
    if j <= i:
        matrix[i, j] = -matrix[i, j]
        matrix[j, i] = matrix[i, j]


@wp.func_native(native_code(__package__, "invert", BLOCK=BLOCK))
def _invert(
    matrix: wp.array2d(dtype=wp.float32), k: wp.int32, out: wp.array2d(dtype=wp.float32)
): ...


@wp.func_native(native_code(__package__, "tiles", BLOCK=BLOCK))
def _multiply(
    left: wp.array2d(dtype=wp.float32),
    left_column: wp.int32,
    right: wp.array2d(dtype=wp.float32),
    right_column: wp.int32,
    sign: wp.float32,
    out: wp.array2d(dtype=wp.float32),
    out_row: wp.int32,
    out_column: wp.int32,
):
    """Set a tile of ``out`` to a product, where ``sign`` is 0, or take the product off it."""


@wp.kernel(enable_backward=False, module="unique")
def invert_block(
    matrix: wp.array2d(dtype=wp.float32), k: wp.int32, out: wp.array2d(dtype=wp.float32)
):
    """Invert a block of pivots; one block of threads has it."""
    _invert(matrix, k, out)


@wp.kernel(enable_backward=False, module="unique")
def scale_row(
    matrix: wp.array2d(dtype=wp.float32),
    k: wp.int32,
    pivot: wp.array2d(dtype=wp.float32),
    row: wp.array2d(dtype=wp.float32),
    scaled: wp.array2d(dtype=wp.float32),
):
    """Copy a row of tiles, and multiply it with the pivot's inverse."""
    i, thread = wp.tid()
    x, y = i * _WIDE, k * _WIDE
    for e in range(thread, _WIDE * _WIDE, wp.block_dim()):
        p, q = e / _WIDE, e % _WIDE
        if i <= k:
            row[p, x + q] = matrix[y + p, x + q]
        else:
            row[q, x + p] = matrix[x + p, y + q]
    _multiply(pivot, 0, row, x, wp.float32(0.0), scaled, 0, x)


@wp.kernel(enable_backward=False, module="unique")
def update(
    row: wp.array2d(dtype=wp.float32),
    scaled: wp.array2d(dtype=wp.float32),
    pivot: wp.array2d(dtype=wp.float32),
    k: wp.int32,
    matrix: wp.array2d(dtype=wp.float32),
):
    """Sweep a block of pivots: one block of threads has a tile, of the lower triangle."""
    i, j, thread = wp.tid()
    y, x = i * _WIDE, j * _WIDE
    if j > i:
        return
    if i == k or j == k:
        for e in range(thread, _WIDE * _WIDE, wp.block_dim()):
            p, q = e / _WIDE, e % _WIDE
            if i == k and j == k:
                matrix[y + p, x + q] = -pivot[p, q]
            elif i == k:
                matrix[y + p, x + q] = scaled[p, x + q]
            else:
                matrix[y + p, x + q] = scaled[q, y + p]
    else:
        _multiply(scaled, y, row, x, wp.float32(1.0), matrix, y, x)
