"""The inverse of the undeformed gel's stiffness, which serves every press on a sensor.

On a processor it is a sparse factor; columns at the surface are solved for when a node is touched
for the first time. On a GPU it is dense and made there (``sweep_kernels``).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from sim.batch import sweep_kernels as kernels
from sim.batch.inverses import DenseProduct, padded_rows, tiling
from sim.device import Device
from sim.solve.linear_solver import linear_solver
from sim.solve.model import Model
from tacauchy_rig.core.arrays import FloatArray, IntArray
from tacauchy_rig.core.errors import ConfigError

# Of a GPU's memory: what a matrix in float32 and its packed half may take.
_MEMORY_SHARE = 0.8


class FactoredRest:
    """A sparse factor, for vectors on a processor.

    Attributes:
        compliance: Block of the inverse at some unknowns [m/N], shape [count, count]; rows that
            were not asked for by ``need`` are zero.
    """

    kind, scaled, unit = wp.float64, False, 1.0

    def __init__(self, model: Model, rows: IntArray, *, count: int) -> None:
        self.row_count, self.column_count = model.pattern.dof_count + 1, count
        self._solver = linear_solver(model.pattern)
        self._solver.factorise(model.rest_hessian_data())
        self._rows = rows
        # Pages of zeros take no memory until they are written.
        self.compliance: Any = wp.array(
            np.zeros((rows.size, rows.size), dtype=np.float32), copy=False, device="cpu"
        )
        self._known = np.zeros(len(rows), dtype=np.bool_)

    def need(self, nodes: IntArray) -> None:
        """Fill the rows of nodes, by their numbers among the surface's."""
        missing = np.unique(nodes[~self._known[nodes]])
        if not len(missing):
            return
        self._known[missing] = True
        wanted, flat = self._rows[missing].reshape(-1), self._rows.reshape(-1)
        right = np.zeros((len(wanted), self.row_count - 1))
        free = wanted >= 0
        right[np.flatnonzero(free), wanted[free]] = 1.0
        found = self._solver.solve(right)[:, flat.clip(min=0)]
        found[:, flat < 0] = 0.0
        at = (3 * missing[:, None] + np.arange(3)).reshape(-1)
        self.compliance.numpy()[at] = found

    def places(self, state: Any) -> None:
        """Return nothing: every environment keeps its column."""

    def apply(self, asked: NDArray[np.int32], sources: Any, found: Any) -> None:
        """Set ``found`` to the inverse times ``sources``, shape [environment_count, row_count]."""
        given, out = sources.numpy(), found.numpy()
        for b in asked:
            out[b, : self.row_count - 1] = self._solver.solve(given[b, : self.row_count - 1])


class DenseRest(DenseProduct):
    """A dense inverse on a GPU; ``compliance`` as ``FactoredRest`` has it, all of it known.

    Raises:
        ConfigError: It does not fit into the GPU's memory.
    """

    def __init__(self, model: Model, rows: IntArray, *, count: int) -> None:
        device = Device(model.device)
        size = model.pattern.dof_count
        whole = -(-size // kernels.BLOCK) * kernels.BLOCK
        room, free = 7 * whole**2, wp.get_device(device.name).free_memory
        if room > _MEMORY_SHARE * free:
            raise ConfigError(
                f"the inverse of {size} unknowns takes {room / 1e9:.1f} GB, and the GPU has "
                f"{free / 1e9:.1f} GB left",
                remedy="choose a longer edge for the sensor's mesh",
            )
        inverse = inverted(_dense(model, whole, device), device)
        flat = device.array(rows.reshape(-1), wp.int32)
        self.compliance = device.zeros((rows.size, rows.size), wp.float32)
        device.launch(kernels.block_at, self.compliance.shape, [inverse, flat], [self.compliance])
        self._tiling, self._device = tiling(count), device
        self.width, self.row_count = self._tiling.columns, padded_rows(size + 1)
        block_count = -(-count // self.width)
        self.blocks, self.column_count = (
            device.zeros(block_count, wp.int32),
            block_count * self.width,
        )
        # The largest entry of a positive definite matrix is on its diagonal.
        diagonal = device.zeros(size, wp.float32)
        device.launch(kernels.diagonal_of, (size,), [inverse], [diagonal])
        self.unit = float(diagonal.numpy().max())
        self._matrices = device.zeros((1, self.row_count**2), wp.float16)
        shape = (self.row_count // 16, self.row_count // 32, 512)
        device.launch(
            kernels.pack, shape, [inverse, size, shape[1], 1.0 / self.unit], [self._matrices]
        )

    def need(self, nodes: IntArray) -> None:
        """Do nothing: all rows are known."""

    def places(self, state: Any) -> Any:
        """Return a launch that gives who asks the first columns, so that few blocks are read."""
        count = len(state.slot)
        return self._device.record(kernels.place, (count,), [state, self.width, self.blocks])


def _dense(model: Model, whole: int, device: Device) -> Any:
    """Return the undeformed stiffness [N/m] as a dense matrix, with ones beyond its unknowns."""
    pattern = model.pattern
    matrix = device.zeros((whole, whole), wp.float32)
    diagonal = device.array(np.arange(pattern.dof_count, whole), wp.int32)
    if whole > pattern.dof_count:
        device.launch(kernels.one_at, (whole - pattern.dof_count,), [diagonal], [matrix])
    rows = np.repeat(np.arange(pattern.dof_count), np.diff(pattern.indptr))
    values: FloatArray = model.rest_hessian_data()
    entries = [device.array(rows, wp.int32), device.array(pattern.indices, wp.int32)]
    entries.append(device.array(values, wp.float32))
    device.launch(kernels.spread, (len(values),), entries, [matrix])
    return matrix


def inverted(matrix: Any, device: Device) -> Any:
    """Invert a symmetric positive definite matrix in its place, shape [size, size].

    The size is a multiple of 64.
    """
    size = matrix.shape[0]
    count = size // kernels.BLOCK
    pivot_inverse = device.zeros((kernels.BLOCK, kernels.BLOCK), wp.float32)
    column, along = (device.zeros((size, kernels.BLOCK), wp.float32) for _ in range(2))
    threads = 256 if device.is_gpu else 1

    def blocks(kernel: Any, shape: tuple[int, ...], inputs: list[Any]) -> None:
        wp.launch(
            kernel, dim=(*shape, threads), inputs=inputs, block_dim=threads, device=device.name
        )

    for k in range(count):
        blocks(kernels.invert_block, (1,), [matrix, k, pivot_inverse])
        blocks(kernels.scale_column, (count,), [matrix, k, pivot_inverse, column, along])
        blocks(kernels.update, (count, count), [column, along, pivot_inverse, k, matrix])
    device.launch(kernels.negate, matrix.shape, [], [matrix])
    return matrix
