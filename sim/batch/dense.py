"""The product of a dense symmetric matrix with a batch of vectors, on a GPU.

A batch shares one matrix, so that the product is one of two matrices, for tensor cores in float16
with float32 sums: a preconditioner needs no more digits. Warp's own tile product takes most of a
minute to compile and leaves the cores idle for so few columns; here each warp feeds them from a
matrix that was laid out for them once.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from sim.batch.dense_kernel import Tiling, product_kernel
from sim.device import Device

# Rows of any block, and terms that a warp takes at once, divide it.
_ROW_PADDING = 288

# Few columns need many blocks that read the matrix, many need blocks that use what they read often.
_TILINGS = {
    8: Tiling(row_tiles=1, column_tiles=1, depth_warps=8),
    64: Tiling(row_tiles=2, column_tiles=4, column_warps=2, depth_warps=4),
    256: Tiling(row_tiles=3, column_tiles=8, column_warps=2, depth_warps=4),
}
_LARGEST = Tiling(row_tiles=3, column_tiles=4, row_warps=3, column_warps=4)


def tiling(columns: int) -> Tiling:
    """Return how a product with so many columns is done."""
    fitting = [limit for limit in _TILINGS if columns <= limit]
    return _TILINGS[fitting[0]] if fitting else _LARGEST


def padded_rows(row_count: int) -> int:
    """Return a row count that the blocks divide."""
    return -(-row_count // _ROW_PADDING) * _ROW_PADDING


class DenseProduct:
    """Multiplies one of several symmetric matrices with a batch of vectors.

    Args:
        matrices: Shape [matrix_count, row_count, row_count].

    Attributes:
        kind: Warp type of the vectors that it takes.
        scaled: It takes them in units of their own size.
        width: Vectors of a block, which are multiplied with one matrix.
        blocks: That of every block, -1 for none, shape [block_count]; there are enough of them for
            vectors that go with unlike matrices.
        unit: What the product must be multiplied with: float16 holds nothing above 65,504.
    """

    kind, scaled = wp.float16, True

    def __init__(self, matrices: NDArray[np.float32], *, count: int, device: Device) -> None:
        matrix_count, rows, _ = matrices.shape
        self._tiling = tiling(count)
        self.width = self._tiling.columns
        # At least a row more than there are: what is fixed reads it.
        self.row_count = padded_rows(rows + 1)
        self.unit = float(np.abs(matrices).max())
        padded = np.zeros((matrix_count, self.row_count, self.row_count), dtype=np.float16)
        padded[:, :rows, :rows] = matrices / self.unit
        full = -(-count // self.width)
        # Each matrix leaves at most one block that is not full.
        blocks = np.full(full + min(count, matrix_count) - 1, -1, dtype=np.int32)
        blocks[:full] = 0
        self.blocks: Any = device.array(blocks, wp.int32)
        self.column_count = len(blocks) * self.width
        self.which: Any = None
        self._device = device
        self._matrices = device.array(packed(padded).reshape(-1), wp.float16)

    def apply(self, asked: NDArray[np.int32] | None, sources: Any, found: Any) -> None:  # noqa: ARG002
        """Set ``found`` to the products of the matrices with ``sources``, over ``unit``.

        Args:
            sources: Float16, shape [column_count, row_count].
            found: Float32, the same shape.
        """
        chosen = self._tiling
        row_blocks = self.row_count // chosen.rows
        blocks = row_blocks * len(self.blocks)
        wp.launch(
            product_kernel(chosen),
            dim=blocks * chosen.threads,
            inputs=[self._matrices, self.blocks, sources, row_blocks],
            outputs=[found],
            block_dim=chosen.threads,
            device=self._device.name,
        )


def packed(matrices: NDArray[np.float16]) -> NDArray[np.float16]:
    """Order matrices as the lanes of a warp take them: [matrix, row tile, step, half, 32, 8]."""
    count, rows, _ = matrices.shape
    tiles = matrices.reshape(count, rows // 16, 2, 8, rows // 32, 4, 2, 2, 2)
    # [matrix, tile, upper or lower, group, step, member, half, low or high, odd] becomes
    # [matrix, tile, step, half, group, member, low or high, upper or lower, odd].
    ordered = tiles.transpose(0, 1, 4, 6, 3, 5, 7, 2, 8)
    return np.ascontiguousarray(ordered).reshape(count, rows // 16, rows // 32, 2, 32, 8)
