"""The product of a dense symmetric matrix with a batch of vectors.

A batch shares one matrix, so that on a GPU the product is one of two matrices, for tensor cores in
TF32: a preconditioner needs no more digits. Warp's own tile product takes most of a minute to
compile and leaves the cores idle for so few columns; here each warp feeds them from a matrix that
was laid out for them once. On the CPU NumPy's BLAS does it.
"""

# Device code: Warp compiles it, and Python type checkers do not speak its dialect.
# mypy: ignore-errors

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import warp as wp

from sim.arrays import FloatArray
from sim.device import Device

_TILE_ROWS, _TILE_DEPTH, _TILE_COLUMNS = 16, 8, 8
_WARPS = 8
_THREADS = 32 * _WARPS
_ROW_PADDING = 64
_COLUMN_PADDING = 64

# One block makes a block of the product, its warps share the sum's terms out among them. Fragments
# as in the PTX manual, mma.m16n8k8 of .tf32; the matrix is packed so that a lane's part of one is
# a float4.
_PRODUCT = """
    const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5;
    const int group = lane >> 2, member = lane & 3;
    const int columns = right.shape[1], steps = right.shape[0] / 8;
    const int row_tile = (block % row_blocks) * ROW_TILES;
    const int first_column = (block / row_blocks) * (8 * COLUMN_TILES);
    const float4* packed = (const float4*)matrices.data;
    packed += (size_t)which.data[0] * (right.shape[0] / 16) * steps * 32;
    __shared__ float total[128 * ROW_TILES * COLUMN_TILES];
    __shared__ float dots[8 * COLUMN_TILES];
    for (int k = threadIdx.x; k < 128 * ROW_TILES * COLUMN_TILES; k += blockDim.x) total[k] = 0.f;
    for (int k = threadIdx.x; k < 8 * COLUMN_TILES; k += blockDim.x) dots[k] = 0.f;
    __syncthreads();
    float sum[ROW_TILES][COLUMN_TILES][4];
    #pragma unroll
    for (int i = 0; i < ROW_TILES; ++i)
        #pragma unroll
        for (int j = 0; j < COLUMN_TILES; ++j)
            #pragma unroll
            for (int k = 0; k < 4; ++k) sum[i][j][k] = 0.f;
    #pragma unroll 2
    for (int s = warp; s < steps; s += WARPS) {
        float4 a[ROW_TILES];
        #pragma unroll
        for (int i = 0; i < ROW_TILES; ++i)
            a[i] = packed[((size_t)(row_tile + i) * steps + s) * 32 + lane];
        const float* low = right.data + (size_t)(8 * s + member) * columns + first_column + group;
        const float* high = low + (size_t)4 * columns;
        #pragma unroll
        for (int j = 0; j < COLUMN_TILES; ++j) {
            unsigned b0, b1;
            asm("cvt.rna.tf32.f32 %0, %1;" : "=r"(b0) : "f"(low[8 * j]));
            asm("cvt.rna.tf32.f32 %0, %1;" : "=r"(b1) : "f"(high[8 * j]));
            #pragma unroll
            for (int i = 0; i < ROW_TILES; ++i)
                asm("mma.sync.aligned.m16n8k8.row.col.f32.tf32.tf32.f32 "
                    "{%0, %1, %2, %3}, {%4, %5, %6, %7}, {%8, %9}, {%0, %1, %2, %3};"
                    : "+f"(sum[i][j][0]), "+f"(sum[i][j][1]), "+f"(sum[i][j][2]),
                      "+f"(sum[i][j][3])
                    : "r"(__float_as_uint(a[i].x)), "r"(__float_as_uint(a[i].y)),
                      "r"(__float_as_uint(a[i].z)), "r"(__float_as_uint(a[i].w)), "r"(b0),
                      "r"(b1));
        }
    }
    #pragma unroll
    for (int i = 0; i < ROW_TILES; ++i)
        #pragma unroll
        for (int j = 0; j < COLUMN_TILES; ++j) {
            const int at = (16 * i + group) * (8 * COLUMN_TILES) + 8 * j + 2 * member;
            const int below = at + 8 * (8 * COLUMN_TILES);
            ::atomicAdd(total + at, sum[i][j][0]);
            ::atomicAdd(total + at + 1, sum[i][j][1]);
            ::atomicAdd(total + below, sum[i][j][2]);
            ::atomicAdd(total + below + 1, sum[i][j][3]);
        }
    __syncthreads();
    const int column = threadIdx.x % (8 * COLUMN_TILES);
    float dot = 0.f;
    for (int k = threadIdx.x; k < 128 * ROW_TILES * COLUMN_TILES; k += blockDim.x) {
        const int row = 16 * row_tile + k / (8 * COLUMN_TILES);
        const size_t at = (size_t)row * columns + first_column + column;
        out.data[at] = total[k];
        dot += total[k] * right.data[at];
    }
    ::atomicAdd(dots + column, dot);
    __syncthreads();
    if (threadIdx.x < 8 * COLUMN_TILES)
        ::atomicAdd(dots_out.data + first_column + threadIdx.x, (double)dots[threadIdx.x]);
"""


def padded_rows(row_count: int) -> int:
    """Return a row count that the blocks divide."""
    return -(-row_count // _ROW_PADDING) * _ROW_PADDING


def padded_columns(environment_count: int) -> int:
    """Return an environment count that the blocks divide."""
    wide = _COLUMN_PADDING if environment_count > _COLUMN_PADDING else _TILE_COLUMNS
    return -(-environment_count // wide) * wide


class DenseProduct:
    """Multiplies one of several symmetric matrices with a batch of vectors.

    Args:
        matrices: Shape [matrix_count, row_count, row_count].

    Attributes:
        row_count: Rows of the padded vectors.
        which: The matrix to be used, on the device, shape [1].
    """

    def __init__(self, matrices: FloatArray, *, device: Device) -> None:
        count, rows, _ = matrices.shape
        self.row_count = padded_rows(rows)
        padded = np.zeros((count, self.row_count, self.row_count), dtype=np.float32)
        padded[:, :rows, :rows] = matrices
        self.which = device.zeros(1, wp.int32)
        self._device = device
        self._on_gpu = wp.get_device(device.name).is_cuda
        self._matrices = _packed(padded) if self._on_gpu else padded
        if self._on_gpu:
            self._matrices = device.array(self._matrices.reshape(-1), wp.float32)

    def apply(self, right: Any, out: Any, dots_out: Any) -> None:
        """Set ``out`` to the product of the matrix with ``right``, and add ``right . out``.

        Args:
            right: Shape [row_count, environment_count].
            out: The same shape.
            dots_out: Shape [environment_count], float64.
        """
        if not self._on_gpu:
            left = self._matrices[int(self.which.numpy()[0])]
            product = np.matmul(left, right.numpy(), out=out.numpy())
            dots = dots_out.numpy()
            dots += np.einsum("rb,rb->b", right.numpy(), product, dtype=np.float64)
            return
        columns = right.shape[1]
        wide = min(columns, _COLUMN_PADDING) // _TILE_COLUMNS
        tall = 1 if columns <= _COLUMN_PADDING else (2 if columns <= 4 * _COLUMN_PADDING else 4)
        row_blocks = self.row_count // (_TILE_ROWS * tall)
        blocks = row_blocks * (columns // (_TILE_COLUMNS * wide))
        wp.launch(
            product_kernel(tall, wide),
            dim=blocks * _THREADS,
            inputs=[self._matrices, self.which, right, row_blocks],
            outputs=[out, dots_out],
            block_dim=_THREADS,
            device=self._device.name,
        )


@cache
def product_kernel(row_tiles: int, column_tiles: int) -> Any:
    """Build the kernel whose blocks make so many tiles of 16 rows and of 8 columns.

    It launches over 256 threads a block.
    """
    snippet = _PRODUCT
    for name, value in (
        ("ROW_TILES", row_tiles),
        ("COLUMN_TILES", column_tiles),
        ("WARPS", _WARPS),
    ):
        snippet = snippet.replace(name, str(value))

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
        block = wp.tid() // wp.static(_THREADS)
        block_product(matrices, which, right, row_blocks, block, product_out, dots_out)

    return product


def _packed(matrices: np.ndarray) -> np.ndarray:
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
