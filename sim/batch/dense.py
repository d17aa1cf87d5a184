"""The product of a dense symmetric matrix with a batch of vectors, on a GPU.

A batch shares one matrix, so that the product is one of two matrices, for tensor cores in TF32: a
preconditioner needs no more digits. Warp's own tile product takes most of a minute to
compile and leaves the cores idle for so few columns; here each warp feeds them from a matrix that
was laid out for them once. On the CPU NumPy's BLAS does it.
"""

# Device code: Warp compiles it, and Python type checkers do not speak its dialect.
# mypy: ignore-errors

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from sim.device import Device

_ROW_PADDING = 128
_WIDE = 64

# One block makes a block of the product. Its warps share out rows and, in DEPTH_WARPS groups, the
# terms of the sums, which are then added group by group in shared memory. Fragments are those of
# the PTX manual's mma.m16n8k8 of .tf32. The matrix is packed so that a lane's part of a fragment is
# a float4; of the vectors a lane takes VECTOR neighbouring columns at once, as columns of VECTOR
# fragments: which column is which does not matter to a product as long as the result agrees.
_PRODUCT = """
    const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5;
    const int group = lane >> 2, member = lane & 3;
    const int part = warp / ROW_WARPS, rows_before = (warp % ROW_WARPS) * 16 * ROW_TILES;
    const int columns = right.shape[1], steps = right.shape[0] / 8;
    const int first_row = (block % row_blocks) * 16 * ROW_TILES * ROW_WARPS;
    const int first_column = (block / row_blocks) * 8 * COLUMN_TILES;
    const int first_tile = (first_row + rows_before) / 16;
    const float4* packed = (const float4*)matrices.data;
    packed += (size_t)which.data[0] * (right.shape[0] / 16) * steps * 32 + lane;
    __shared__ float total[BUFFERS * TILE];
    __shared__ float dots[8 * COLUMN_TILES];
    float sum[ROW_TILES][COLUMN_TILES][4];
    #pragma unroll
    for (int i = 0; i < ROW_TILES; ++i)
        #pragma unroll
        for (int j = 0; j < COLUMN_TILES; ++j)
            #pragma unroll
            for (int k = 0; k < 4; ++k) sum[i][j][k] = 0.f;
    #pragma unroll 2
    for (int s = part; s < steps; s += DEPTH_WARPS) {
        float4 a[ROW_TILES];
        #pragma unroll
        for (int i = 0; i < ROW_TILES; ++i)
            a[i] = packed[((size_t)(first_tile + i) * steps + s) * 32];
        const float* low = right.data + (size_t)(8 * s + member) * columns;
        low += first_column + group * VECTOR;
        const float* high = low + (size_t)4 * columns;
        #pragma unroll
        for (int j = 0; j < COLUMN_TILES; j += VECTOR) {
            const LOADED b0 = *(const LOADED*)(low + 8 * j), b1 = *(const LOADED*)(high + 8 * j);
            #pragma unroll
            for (int v = 0; v < VECTOR; ++v)
                #pragma unroll
                for (int i = 0; i < ROW_TILES; ++i) {
                    float* c = sum[i][j + v];
                    asm("mma.sync.aligned.m16n8k8.row.col.f32.tf32.tf32.f32 "
                        "{%0, %1, %2, %3}, {%4, %5, %6, %7}, {%8, %9}, {%0, %1, %2, %3};"
                        : "+f"(c[0]), "+f"(c[1]), "+f"(c[2]), "+f"(c[3])
                        : "r"(__float_as_uint(a[i].x)), "r"(__float_as_uint(a[i].y)),
                          "r"(__float_as_uint(a[i].z)), "r"(__float_as_uint(a[i].w)),
                          "r"(__float_as_uint(((const float*)&b0)[v])),
                          "r"(__float_as_uint(((const float*)&b1)[v])));
                }
        }
    }
    if (threadIdx.x < 8 * COLUMN_TILES) dots[threadIdx.x] = 0.f;
    for (int round = 0; round < DEPTH_WARPS / BUFFERS; ++round) {
        if (part / BUFFERS == round) {
            float* mine = total + (part % BUFFERS) * TILE;
            #pragma unroll
            for (int i = 0; i < ROW_TILES; ++i)
                #pragma unroll
                for (int j = 0; j < COLUMN_TILES; ++j)
                    #pragma unroll
                    for (int k = 0; k < 4; ++k) {
                        const int row = rows_before + 16 * i + group + 8 * (k / 2);
                        const int column = 8 * (j / VECTOR) * VECTOR + j % VECTOR
                            + (2 * member + k % 2) * VECTOR;
                        float* at = mine + row * (8 * COLUMN_TILES) + column;
                        *at = round == 0 ? sum[i][j][k] : *at + sum[i][j][k];
                    }
        }
        __syncthreads();
    }
    const int column = threadIdx.x % (8 * COLUMN_TILES);
    float dot = 0.f;
    for (int k = threadIdx.x; k < TILE; k += blockDim.x) {
        float z = total[k];
        #pragma unroll
        for (int buffer = 1; buffer < BUFFERS; ++buffer) z += total[buffer * TILE + k];
        const size_t at = (size_t)(first_row + k / (8 * COLUMN_TILES)) * columns + first_column;
        out.data[at + column] = z;
        dot += z * right.data[at + column];
    }
    ::atomicAdd(dots + column, dot);
    __syncthreads();
    if (threadIdx.x < 8 * COLUMN_TILES)
        ::atomicAdd(dots_out.data + first_column + threadIdx.x, (double)dots[threadIdx.x]);
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tiling:
    """How a block of the product is shared out among warps.

    Attributes:
        row_tiles: Tiles of 16 rows that a warp makes.
        column_tiles: Tiles of 8 columns that a block and each of its warps make.
        row_warps: Warps beside each other.
        depth_warps: Warps that share the terms of a sum.
        buffers: Partial sums in shared memory.
    """

    row_tiles: int
    column_tiles: int
    row_warps: int
    depth_warps: int
    buffers: int

    @property
    def rows(self) -> int:
        """Rows of a block."""
        return 16 * self.row_tiles * self.row_warps

    @property
    def columns(self) -> int:
        """Columns of a block."""
        return 8 * self.column_tiles

    @property
    def threads(self) -> int:
        """Threads of a block."""
        return 32 * self.row_warps * self.depth_warps


# Few columns need many blocks that read the matrix, many need blocks that use what they read often.
_TILINGS = {
    8: Tiling(row_tiles=1, column_tiles=1, row_warps=1, depth_warps=8, buffers=8),
    32: Tiling(row_tiles=1, column_tiles=4, row_warps=1, depth_warps=8, buffers=4),
    64: Tiling(row_tiles=2, column_tiles=8, row_warps=1, depth_warps=8, buffers=4),
    256: Tiling(row_tiles=4, column_tiles=8, row_warps=1, depth_warps=8, buffers=2),
}
_LARGEST = Tiling(row_tiles=4, column_tiles=8, row_warps=2, depth_warps=4, buffers=1)


def tiling(columns: int) -> Tiling:
    """Return how a product with so many columns is done."""
    fitting = [limit for limit in _TILINGS if columns <= limit]
    return _TILINGS[fitting[0]] if fitting else _LARGEST


def padded_rows(row_count: int) -> int:
    """Return a row count that the blocks divide."""
    return -(-row_count // _ROW_PADDING) * _ROW_PADDING


def padded_columns(environment_count: int) -> int:
    """Return an environment count that the blocks divide."""
    width = tiling(environment_count).columns
    return -(-environment_count // width) * width


class DenseProduct:
    """Multiplies one of several symmetric matrices with a batch of vectors.

    Args:
        matrices: Shape [matrix_count, row_count, row_count].

    Attributes:
        row_count: Rows of the padded vectors.
    """

    def __init__(self, matrices: NDArray[np.float32], *, device: Device) -> None:
        count, rows, _ = matrices.shape
        self.row_count = padded_rows(rows)
        padded = np.zeros((count, self.row_count, self.row_count), dtype=np.float32)
        padded[:, :rows, :rows] = matrices
        self._which = device.zeros(1, wp.int32)
        self._device = device
        self._matrices = device.array(packed(padded).reshape(-1), wp.float32)

    def select(self, which: int) -> None:
        """Take another of the matrices from now on."""
        self._which.fill_(which)

    def apply(self, right: Any, out: Any, dots_out: Any) -> None:
        """Set ``out`` to the product of the matrix with ``right``, and add ``right . out``.

        Args:
            right: Shape [row_count, environment_count].
            out: The same shape.
            dots_out: Shape [environment_count], float64.
        """
        chosen = tiling(right.shape[1])
        row_blocks = self.row_count // chosen.rows
        blocks = row_blocks * (right.shape[1] // chosen.columns)
        wp.launch(
            product_kernel(chosen),
            dim=blocks * chosen.threads,
            inputs=[self._matrices, self._which, right, row_blocks],
            outputs=[out, dots_out],
            block_dim=chosen.threads,
            device=self._device.name,
        )


@cache
def product_kernel(chosen: Tiling) -> Any:
    """Build the kernel of a tiling; it launches over the threads of all its blocks."""
    vector = 4 if chosen.column_tiles % 4 == 0 else 1
    snippet = _PRODUCT
    for name, value in (
        ("ROW_TILES", chosen.row_tiles),
        ("COLUMN_TILES", chosen.column_tiles),
        ("ROW_WARPS", chosen.row_warps),
        ("DEPTH_WARPS", chosen.depth_warps),
        ("BUFFERS", chosen.buffers),
        ("TILE", chosen.rows * chosen.columns),
        ("VECTOR", vector),
        ("LOADED", "float4" if vector == 4 else "float"),
    ):
        snippet = re.sub(rf"\b{name}\b", str(value), snippet)
    threads = chosen.threads

    @wp.func_native(snippet)
    def block_product(
        matrices: wp.array(dtype=wp.float32),
        which: wp.array(dtype=wp.int32),
        right: wp.array2d(dtype=wp.float32),
        row_blocks: wp.int32,
        block: wp.int32,
        out: wp.array2d(dtype=wp.float32),
        dots_out: wp.array(dtype=wp.float64),
    ): ...

    @wp.kernel(enable_backward=False, module="unique")
    def product(
        matrices: wp.array(dtype=wp.float32),
        which: wp.array(dtype=wp.int32),
        right: wp.array2d(dtype=wp.float32),
        row_blocks: wp.int32,
        product_out: wp.array2d(dtype=wp.float32),
        dots_out: wp.array(dtype=wp.float64),
    ):
        block = wp.tid() // wp.static(threads)
        block_product(matrices, which, right, row_blocks, block, product_out, dots_out)

    return product


def packed(matrices: np.ndarray) -> np.ndarray:
    """Round to TF32 and order as the lanes of a warp take it.

    Returns:
        Shape [matrix_count, row_tile, step, 32, 4].
    """
    count, rows, _ = matrices.shape
    bits = matrices.view(np.uint32)
    rounded = ((bits + np.uint32(0x1000)) & np.uint32(0xFFFFE000)).view(np.float32)
    tiles = rounded.reshape(count, rows // 16, 2, 8, rows // 8, 2, 4)
    # [matrix, tile, upper or lower half, group, step, left or right half, member]
    return np.ascontiguousarray(tiles.transpose(0, 1, 4, 3, 6, 5, 2)).reshape(
        count, rows // 16, rows // 8, 32, 4
    )
