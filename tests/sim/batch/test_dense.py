"""The layout of the shared matrix, checked by doing on the host what the GPU's lanes do."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from sim.batch.dense import DenseProduct, packed, padded_columns, padded_rows, tiling
from sim.device import Device


def test_a_lane_finds_its_entries() -> None:
    """Lane 4 g + m of a step holds rows g and g + 8, columns m and m + 4, in the PTX order."""
    rng = np.random.default_rng(0)
    matrix = rng.integers(-500, 500, (2, 128, 128)).astype(np.float32)
    found = packed(matrix)
    for which, tile, step, group, member in rng.integers([2, 8, 16, 8, 4], size=(50, 5)):
        row, column = 16 * tile + group, 8 * step + member
        wanted = [matrix[which, row + r, column + c] for c in (0, 4) for r in (0, 8)]
        assert found[which, tile, step, 4 * group + member].tolist() == wanted


def test_entries_are_rounded_to_tf32() -> None:
    """Ten bits of the mantissa are left, rounded to nearest."""
    matrix = np.random.default_rng(1).standard_normal((1, 128, 128)).astype(np.float32)
    found = packed(matrix)
    assert not np.any(found.view(np.uint32) & np.uint32(0x1FFF))
    assert np.abs(np.sort(found.ravel()) - np.sort(matrix.ravel())).max() <= 2.0**-11 * 4.0


@pytest.mark.parametrize("count", [1, 8, 9, 60, 64, 65, 256, 257, 1024])
def test_paddings_are_what_blocks_divide(count: int) -> None:
    """Columns and rows hold a whole number of blocks, and no fewer than asked."""
    columns = padded_columns(count)
    chosen = tiling(columns)
    assert count <= columns < count + 64
    assert columns % chosen.columns == 0
    assert padded_rows(1000) % chosen.rows == 0
    assert chosen.depth_warps % chosen.buffers == 0


@pytest.mark.gpu
@pytest.mark.parametrize("columns", [1, 8, 32, 64, 256, 320])
def test_product_and_dots(columns: int) -> None:
    """The product is NumPy's to TF32, and the dots are those of its columns."""
    rng = np.random.default_rng(2)
    matrices = rng.standard_normal((2, 300, 300)).astype(np.float32)
    matrices += np.swapaxes(matrices, 1, 2)
    on = Device("cuda:0")
    product = DenseProduct(matrices, device=on)
    product.select(1)
    columns = padded_columns(columns)
    right = np.zeros((product.row_count, columns), dtype=np.float32)
    right[:300] = rng.standard_normal((300, columns))
    out, dots = on.zeros(right.shape, wp.float32), on.zeros(columns, wp.float64)
    product.apply(on.array(right, wp.float32), out, dots)
    wanted = matrices[1].astype(np.float64) @ right[:300]
    limit = 2e-3 * np.abs(wanted).max()
    assert np.abs(out.numpy()[:300] - wanted).max() <= limit
    assert np.abs(dots.numpy() - np.einsum("rb,rb->b", right[:300], wanted)).max() <= 30.0 * limit
