"""The inverse of the undeformed gel's stiffness, which serves every press on a sensor.

docs/decisions/0006-batches-share-the-undeformed-inverse.md says why. On a processor, columns at the
surface are solved for when a node is touched for the first time. Warp's own tile product takes most
of a minute to compile and leaves a GPU's tensor cores idle for so few columns; here each warp feeds
them from a matrix that was laid out for them once, with float32 sums.
"""

from typing import Any

import numpy as np
import warp as wp

from sim.batch import dense_inverse_kernels as kernels
from sim.batch.dense_kernel import Tiling, product_kernel
from sim.device import Device
from sim.solve.linear_solver import linear_solver
from sim.solve.model import Model
from tacauchy_rig.core.arrays import IntArray
from tacauchy_rig.core.errors import ConfigError

# Of a GPU's memory: what a matrix in float32 and its packed half may take.
_MEMORY_SHARE = 0.8
# Rows of any block, and terms that a warp takes at once, divide it.
_ROW_PADDING = 288
# Warp counts the entries of an array by 31 bits.
_MOST_ROWS = 46_340
# Few columns need many blocks that read the matrix, many need blocks that use what they read often.
_FEW = Tiling(row_tiles=1, column_tiles=1, depth_warps=8)
_SOME, _SOME_COLUMNS = Tiling(row_tiles=6, column_tiles=4, depth_warps=4), 256
_MANY = Tiling(row_tiles=3, column_tiles=4, row_warps=3, column_warps=4)
# Threads of the block that counts who asks.
_PLACERS = 1024


class FactoredRest:
    """A sparse factor, for vectors on a processor.

    Attributes:
        compliance: Block of the inverse at some unknowns [m/N], shape [count, count]; rows that
            were not asked for by ``need`` are zero.
    """

    kind, scaled, unit = wp.float64, False, 1.0

    def __init__(self, model: Model, rows: IntArray, *, count: int) -> None:
        self.row_count, self.column_count = model.pattern.dof_count + 1, count
        self.weights = Device("cpu").array(np.ones(self.row_count), wp.float32)
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

    def apply(self, asked: Any, sources: Any, found: Any, *, at_surface: bool = False) -> None:
        """Set ``found`` to the inverse times ``sources``, shape [environment_count, row_count].

        With ``at_surface`` only its rows at the surface are needed.
        """
        del at_surface  # a factor gives all rows
        given, out = sources.numpy(), found.numpy()
        for b in asked:
            out[b, : self.row_count - 1] = self._solver.solve(given[b, : self.row_count - 1])


class DenseRest:
    """A dense inverse on a GPU; ``compliance`` as ``FactoredRest`` has it, all of it known.

    Attributes:
        kind: Warp type of the vectors that it takes.
        scaled: It takes them in units of their own size.
        blocks: 0 for a block of columns that is multiplied, -1 for another, shape [block_count].
        few: Likewise of the first 8 columns, where no more are asked for, shape [1].
        unit: What the product must be multiplied with; float16 holds nothing above 65,504.
        weights: What is multiplied, and the product, must be multiplied with these, shape
            [row_count]: each entry is then as exact as its own diagonal ones, of stiff layers too.

    Raises:
        ConfigError: It does not fit into the GPU's memory or an array.
    """

    kind, scaled = wp.float16, True

    def __init__(self, model: Model, rows: IntArray, *, count: int) -> None:
        self._device = device = Device(model.device)
        size = model.pattern.dof_count
        whole = -(-size // kernels.BLOCK) * kernels.BLOCK
        room, free = 7 * whole**2, wp.get_device(device.name).free_memory
        # At least a row more than there are: what is fixed reads it.
        self.row_count = -(-(size + 1) // _ROW_PADDING) * _ROW_PADDING
        why = ""
        if self.row_count > _MOST_ROWS:
            why = f"{size} unknowns: a GPU's array holds the inverse of {_MOST_ROWS} at most"
        elif room > _MEMORY_SHARE * free:
            why = f"the inverse of {size} unknowns takes {room / 1e9:.1f} GB, and the GPU has "
            why += f"{free / 1e9:.1f} GB left"
        if why:
            raise ConfigError(why, remedy="choose a longer edge for the sensor's mesh")
        inverse = inverted(_dense(model, whole, device), device)
        flat = device.array(rows.reshape(-1), wp.int32)
        self.compliance = device.zeros((rows.size, rows.size), wp.float32)
        device.launch(kernels.block_at, self.compliance.shape, [inverse, flat], [self.compliance])
        self._tiling = _SOME if count <= _SOME_COLUMNS else _MANY
        block_count = -(-count // self._tiling.columns)
        self.blocks, self.few = device.zeros(block_count, wp.int32), device.zeros(1, wp.int32)
        self.column_count = block_count * self._tiling.columns
        # The largest entry of a positive definite matrix is on its diagonal.
        diagonal = device.zeros(size, wp.float32)
        device.launch(kernels.diagonal_of, (size,), [inverse], [diagonal])
        self.unit = float(diagonal.numpy().max())
        weights = np.ones(self.row_count)
        weights[:size] = np.sqrt(diagonal.numpy() / self.unit)
        self.weights = device.array(weights, wp.float32)
        # Rows at the surface come first: a product may end with them.
        at_surface = np.unique(rows[rows >= 0])
        others = np.setdiff1d(np.arange(self.row_count), at_surface)
        self._order = device.array(np.concatenate([at_surface, others]), wp.int32)
        self._surface_count = len(at_surface)
        self._matrix = device.zeros((1, self.row_count**2), wp.float16)
        shape = (self.row_count // 16, self.row_count // 32, 512)
        packed = [inverse, size, shape[1], 1.0 / self.unit, self.weights, self._order]
        device.launch(kernels.pack, shape, packed, [self._matrix])

    def need(self, nodes: IntArray) -> None:
        """Do nothing: all rows are known."""

    def places(self, state: Any) -> Any:
        """Return a launch that gives who asks the first columns, so that few blocks are read."""
        inputs = [state, self._tiling.columns, _FEW.columns, self.blocks, self.few]
        return self._device.record(kernels.place, (_PLACERS,), inputs, _PLACERS)

    def apply(self, _asked: Any, sources: Any, found: Any, *, at_surface: bool = False) -> None:
        """Set ``found`` to the products of the inverse with ``sources``, over unit and weights.

        Args:
            sources: Float16, shape [column_count, row_count].
            found: Float32, the same shape.
            at_surface: Only the rows at the surface are needed; most others stay as they are.
        """
        rows = self._surface_count if at_surface else self.row_count
        for chosen, blocks in ((_FEW, self.few), (self._tiling, self.blocks)):
            row_blocks = -(-rows // chosen.rows)
            wp.launch(
                product_kernel(chosen),
                dim=row_blocks * len(blocks) * chosen.threads,
                inputs=[self._matrix, blocks, sources, self._order, row_blocks],
                outputs=[found],
                block_dim=chosen.threads,
                device=self._device.name,
            )


def _dense(model: Model, whole: int, device: Device) -> Any:
    """Return the undeformed stiffness [N/m] as a dense matrix, with ones beyond its unknowns."""
    pattern = model.pattern
    matrix = device.zeros((whole, whole), wp.float32)
    beyond = np.arange(pattern.dof_count, whole)
    rows = np.repeat(np.arange(pattern.dof_count), np.diff(pattern.indptr))
    places = (np.append(each, beyond) for each in (rows, pattern.indices))
    values = np.append(model.rest_hessian_data(), np.ones(len(beyond)))
    entries = [*(device.array(each, wp.int32) for each in places), device.array(values, wp.float32)]
    device.launch(kernels.spread, (len(values),), entries, [matrix])
    return matrix


def inverted(matrix: Any, device: Device) -> Any:
    """Invert a symmetric positive definite matrix in its place; its size is a multiple of 64."""
    size = matrix.shape[0]
    count = size // kernels.BLOCK
    pivot_inverse = device.zeros((kernels.BLOCK, kernels.BLOCK), wp.float32)
    row, scaled = (device.zeros((kernels.BLOCK, size), wp.float32) for _ in range(2))

    def blocks(kernel: Any, shape: tuple[int, ...], inputs: list[Any], threads: int = 64) -> None:
        many = threads if device.is_gpu else 1
        wp.launch(kernel, dim=(*shape, many), inputs=inputs, block_dim=many, device=device.name)

    for k in range(count):
        blocks(kernels.invert_block, (1,), [matrix, k, pivot_inverse], 256)
        blocks(kernels.scale_row, (count,), [matrix, k, pivot_inverse, row, scaled])
        blocks(kernels.update, (count, count), [row, scaled, pivot_inverse, k, matrix])
    device.launch(kernels.negate, matrix.shape, [], [matrix])
    return matrix
