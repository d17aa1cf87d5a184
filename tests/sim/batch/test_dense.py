"""The layout of the shared matrix, checked by doing on the host what the GPU's lanes do."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from sim.batch.dense import DenseProduct, packed, padded_rows, tiling
from sim.device import Device


def test_a_lane_finds_its_entries() -> None:
    """Lane 4 g + m takes rows g and g + 8, and of the columns those it takes of a vector."""
    rng = np.random.default_rng(0)
    matrix = rng.integers(-500, 500, (2, 288, 288)).astype(np.float16)
    found = packed(matrix)
    for which, tile, step, half, group, member in rng.integers([2, 18, 9, 2, 8, 4], size=(50, 6)):
        row, column = 16 * tile + group, 32 * step + 8 * member + 4 * half
        wanted = [
            matrix[which, row + upper, column + low + odd]
            for low in (0, 2)
            for upper in (0, 8)
            for odd in (0, 1)
        ]
        assert found[which, tile, step, half, 4 * group + member].tolist() == wanted


@pytest.mark.parametrize("count", [1, 8, 9, 60, 64, 65, 256, 257, 1024])
def test_paddings_are_what_blocks_divide(count: int) -> None:
    """Rows hold a whole number of blocks, and no fewer than asked."""
    chosen = tiling(count)
    assert 1000 <= padded_rows(1000) < 1000 + 288
    assert padded_rows(1000) % chosen.rows == 0
    assert padded_rows(1000) % 32 == 0


@pytest.mark.gpu
@pytest.mark.parametrize("columns", [1, 8, 32, 64, 256, 320])
def test_product(columns: int) -> None:
    """Every block's product with its matrix is NumPy's to float16; one without rests."""
    rng = np.random.default_rng(2)
    matrices = 1e5 * rng.standard_normal((2, 300, 300)).astype(np.float32)
    matrices += np.swapaxes(matrices, 1, 2)
    on = Device("cuda:0")
    product = DenseProduct(matrices, count=columns, device=on)
    serving = np.arange(len(product.blocks)) % 3 - 1
    product.blocks.assign(serving.astype(np.int32))
    right = np.zeros((product.column_count, product.row_count), dtype=np.float16)
    right[:, :300] = rng.standard_normal((len(right), 300))
    scale = np.abs(right[:, :300].astype(np.float64) @ matrices[1]).max()
    out = on.zeros(right.shape, wp.float32)
    product.apply(None, on.array(right, wp.float16), out)
    for block, matrix in enumerate(serving):
        within = slice(block * product.width, (block + 1) * product.width)
        wanted = right[within, :300].astype(np.float64) @ matrices[matrix]
        wanted *= matrix >= 0
        error = np.abs(product.unit * out.numpy()[within, :300] - wanted).max()
        assert error <= 2e-3 * scale
