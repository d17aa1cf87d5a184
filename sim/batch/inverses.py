"""Inverses of the stiffness at a few points of a pilot press, which serve all environments.

On a processor they are sparse factors. On a GPU they are dense, so that applying one to a batch is
one product of two matrices, for tensor cores in float16 with float32 sums: a preconditioner needs
no more digits. Warp's own tile product takes most of a minute to compile and leaves the cores idle
for so few columns; here each warp feeds them from a matrix that was laid out for them once.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from sim.batch.dense_kernel import Tiling, product_kernel
from sim.batch.pilot import Pilot, PilotState
from sim.device import Device
from sim.mesh.discretisation import SparsePattern
from sim.solve.linear_solver import BorderedSolver, linear_solver
from tacauchy_rig.core.errors import ConfigError

# Thirty dense inverses of this size, as a sliding press of twenty frames has, are 15 GB, and take a
# processor minutes to make.
_UNKNOWNS_MAX = 16_000
# Columns of a dense inverse that are solved for at once.
_AT_ONCE = 64
# Rows of any block, and terms that a warp takes at once, divide it.
_ROW_PADDING = 288

# Few columns need many blocks that read the matrix, many need blocks that use what they read often.
_TILINGS = {
    8: Tiling(row_tiles=1, column_tiles=1, depth_warps=8),
    256: Tiling(row_tiles=6, column_tiles=4, depth_warps=4),
}
_LARGEST = Tiling(row_tiles=3, column_tiles=4, row_warps=3, column_warps=4)


def inverses_for(pilot: Pilot, device: Device, *, count: int) -> FactoredInverses | DenseProduct:
    """Return a pilot's inverses in the form that suits a device, for so many environments.

    Raises:
        ConfigError: There are too many unknowns for dense ones, or they do not fit on the GPU.
    """
    if not device.is_gpu:
        return FactoredInverses(pilot, count=count)
    pattern, pushed = pilot.model.pattern, pilot.is_pushed
    free = wp.get_device(device.name).free_memory
    size = 2 * len(pilot.states) * padded_rows(pattern.dof_count + 2) ** 2
    if pattern.dof_count > _UNKNOWNS_MAX or size > free:
        raise ConfigError(
            f"{len(pilot.states)} inverses of {pattern.dof_count} unknowns, {size / 1e9:.1f} GB: a "
            f"GPU takes {_UNKNOWNS_MAX} unknowns at most, and has {free / 1e9:.1f} GB left",
            remedy="use preset fast or fewer frames, or press one by one",
        )
    if pilot.dense is None:
        pilot.dense = in_threads(
            lambda each: dense_inverse(each, pattern, pushed=pushed), pilot.states
        )
    return DenseProduct(pilot.dense, count=count, device=device)


def in_threads(function: Callable[[Any], Any], given: Iterable[Any]) -> list[Any]:
    """Return what a function makes of each that is given, on all processors."""
    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as threads:
        return list(threads.map(function, given))


def dense_inverse(
    stiffness: PilotState, pattern: SparsePattern, *, pushed: bool
) -> NDArray[np.float32]:
    """Return the dense inverse [m/N], the indenter's height last, [dof_count + 1] squared.

    Where that is no unknown, its row and column are zero. Columns are solutions by the sparse
    factor, many at once, which takes a fraction of the time of a dense inversion.
    """
    factor = _factored(stiffness, pattern, pushed=pushed)
    size = pattern.dof_count + 1
    inverse = np.zeros((size, size), dtype=np.float32)
    for first in range(0, size, _AT_ONCE):
        last = min(size, first + _AT_ONCE)
        inverse[first:last] = factor.solve(np.eye(last - first, size, first))
    return inverse


class FactoredInverses:
    """Sparse factors, for vectors on a processor.

    Attributes:
        which: The one that serves an environment, shape [environment_count].
        blocks: None; every environment keeps its column, which is a ``width`` of 0.
    """

    kind, scaled, unit, width = wp.float64, False, 1.0, 0

    def __init__(self, pilot: Pilot, *, count: int) -> None:
        self.row_count, self.column_count = pilot.model.pattern.dof_count + 1, count
        self.which: Any = wp.zeros(count, dtype=wp.int32, device="cpu")
        self.blocks: Any = wp.zeros(0, dtype=wp.int32, device="cpu")
        self._factors = [
            _factored(stiffness, pilot.model.pattern, pushed=pilot.is_pushed)
            for stiffness in pilot.states
        ]

    def apply(self, asked: NDArray[np.int32] | None, sources: Any, found: Any) -> None:
        """Set ``found`` to the inverse times ``sources``, shape [environment_count, row_count]."""
        which, given, out = self.which.numpy(), sources.numpy(), found.numpy()
        for b in [] if asked is None else asked:
            out[b] = self._factors[which[b]].solve(given[b])


def _factored(stiffness: PilotState, pattern: SparsePattern, *, pushed: bool) -> BorderedSolver:
    solver = linear_solver(pattern)
    solver.factorise(stiffness.data)
    return BorderedSolver(solver, stiffness.border if pushed else None, stiffness.corner)


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
        matrices: Of shape [row_count, row_count] each.

    Attributes:
        kind: Warp type of the vectors that it takes.
        scaled: It takes them in units of their own size.
        width: Vectors of a block, which are multiplied with one matrix.
        blocks: That of every block, -1 for none, shape [block_count]; there are enough of them for
            vectors that go with unlike matrices.
        unit: What the product must be multiplied with: float16 holds nothing above 65,504.
    """

    kind, scaled = wp.float16, True

    def __init__(
        self, matrices: Sequence[NDArray[np.float32]], *, count: int, device: Device
    ) -> None:
        matrix_count, rows = len(matrices), len(matrices[0])
        self._tiling = tiling(count)
        self.width = self._tiling.columns
        # At least a row more than there are: what is fixed reads it.
        self.row_count = padded_rows(rows + 1)
        self.unit = float(max(in_threads(lambda each: np.abs(each).max(), matrices)))

        def half(matrix: NDArray[np.float32]) -> NDArray[np.float16]:
            padded = np.zeros((self.row_count, self.row_count), dtype=np.float16)
            padded[:rows, :rows] = matrix / self.unit
            return packed(padded).reshape(-1)

        full = -(-count // self.width)
        # Each matrix leaves at most one block that is not full.
        blocks = np.full(full + min(count, matrix_count) - 1, -1, dtype=np.int32)
        blocks[:full] = 0
        self.blocks: Any = device.array(blocks, wp.int32)
        self.column_count = len(blocks) * self.width
        self.which: Any = None
        self._device = device
        # A dimension of an array holds 2^31 numbers, of which thirty such matrices have more.
        self._matrices = device.empty((matrix_count, self.row_count**2), wp.float16)
        for k, matrix in enumerate(in_threads(half, matrices)):
            self._matrices[k].assign(matrix)

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


def packed(matrix: NDArray[np.float16]) -> NDArray[np.float16]:
    """Order a matrix as the lanes of a warp take it: [row tile, step, half, 32, 8]."""
    rows = len(matrix)
    tiles = matrix.reshape(rows // 16, 2, 8, rows // 32, 4, 2, 2, 2)
    # [tile, upper or lower, group, step, member, half, low or high, odd] becomes
    # [tile, step, half, group, member, low or high, upper or lower, odd].
    ordered = tiles.transpose(0, 3, 5, 2, 4, 6, 1, 7)
    return np.ascontiguousarray(ordered).reshape(rows // 16, rows // 32, 2, 32, 8)
