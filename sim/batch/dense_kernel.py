"""Warp kernel of the product of a dense matrix with many vectors, on a GPU's tensor cores."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from sim.device import native_code


@dataclass(frozen=True, slots=True, kw_only=True)
class Tiling:
    """How a block of the product is shared out among warps."""

    row_tiles: int  # tiles of 16 rows that a warp makes
    column_tiles: int  # tiles of 8 columns that a warp makes
    row_warps: int = 1  # warps beside each other along the rows
    column_warps: int = 1  # warps beside each other along the columns
    depth_warps: int = 1  # warps that share the terms of a sum

    @property
    def rows(self) -> int:
        """Rows of a block."""
        return 16 * self.row_tiles * self.row_warps

    @property
    def columns(self) -> int:
        """Columns of a block."""
        return 8 * self.column_tiles * self.column_warps

    @property
    def threads(self) -> int:
        """Threads of a block."""
        return 32 * self.row_warps * self.column_warps * self.depth_warps


@cache
def product_kernel(chosen: Tiling) -> Any:
    """Build the kernel of a tiling; it launches over the threads of all its blocks."""
    code = native_code(
        __package__,
        "product",
        ROW_TILES=chosen.row_tiles,
        COLUMN_TILES=chosen.column_tiles,
        ROW_WARPS=chosen.row_warps,
        COLUMN_WARPS=chosen.column_warps,
        DEPTH_WARPS=chosen.depth_warps,
        TILE_ROWS=chosen.rows,
        TILE_COLUMNS=chosen.columns,
        SHARED=(chosen.rows + 4) * chosen.columns if chosen.depth_warps > 1 else 1,
    )
    threads = chosen.threads

    @wp.func_native(code)
    def block_product(
        matrices: wp.array2d(dtype=wp.float16),
        which: wp.array(dtype=wp.int32),
        right: wp.array2d(dtype=wp.float16),
        order: wp.array(dtype=wp.int32),
        row_blocks: wp.int32,
        block: wp.int32,
        out: wp.array2d(dtype=wp.float32),
    ): ...

    @wp.kernel(enable_backward=False, module="unique")
    def product(
        matrices: wp.array2d(dtype=wp.float16),
        which: wp.array(dtype=wp.int32),
        right: wp.array2d(dtype=wp.float16),
        order: wp.array(dtype=wp.int32),
        row_blocks: wp.int32,
        product_out: wp.array2d(dtype=wp.float32),
    ):
        block = wp.tid() // wp.static(threads)
        block_product(matrices, which, right, order, row_blocks, block, product_out)

    return product
