"""The fixed sparsity of the Newton matrix: built once, filled by the kernels, read by the solver.

Clamped nodes are left out, so the matrix holds free degrees of freedom only. Kernels add 3 x 3
blocks of the upper triangle; one gather turns them into the scalar CSR data that solvers take.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True, kw_only=True)
class SparsePattern:
    """Upper triangle of a symmetric matrix over the free nodes.

    Attributes:
        free_nodes: Node of each block row, shape [free_count].
        free_index: Block row of each node, -1 where clamped, shape [node_count].
        block_count: Blocks that the kernels fill.
        indptr: CSR row starts, shape [3 free_count + 1].
        indices: CSR columns, sorted, diagonal included.
        gather: Position of each CSR value in the flat blocks, shape [nnz].
    """

    free_nodes: IntArray
    free_index: IntArray
    block_count: int
    block_keys: np.ndarray[tuple[int], np.dtype[np.int64]]
    indptr: IntArray
    indices: IntArray
    gather: np.ndarray[tuple[int], np.dtype[np.int64]]

    @property
    def dof_count(self) -> int:
        """Scalar unknowns."""
        return 3 * len(self.free_nodes)

    def slots(self, elements: IntArray) -> IntArray:
        """Return 2 * block index + transposed for each node pair, shape [n, k, k]; -1 for none."""
        rows, columns = _pairs(self.free_index[elements])
        keys = np.minimum(rows, columns).astype(np.int64) * len(self.free_nodes) + np.maximum(
            rows, columns
        )
        index = np.searchsorted(self.block_keys, keys)
        slots = 2 * index + (rows > columns)
        return np.where((rows < 0) | (columns < 0), -1, slots).astype(np.int32)

    def csr_data(self, block_values: FloatArray) -> FloatArray:
        """Return the CSR values of filled blocks, shape [block_count, 3, 3]."""
        return np.asarray(block_values.reshape(-1)[self.gather])


def sparse_pattern(
    elements: IntArray, clamped: np.ndarray[tuple[int], np.dtype[np.bool_]]
) -> SparsePattern:
    """Build the pattern of a mesh.

    Args:
        elements: Shape [element_count, element_node_count].
        clamped: True for nodes that cannot move, shape [node_count].
    """
    free_nodes = np.flatnonzero(~clamped).astype(np.int32)
    free_index = np.full(len(clamped), -1, dtype=np.int32)
    free_index[free_nodes] = np.arange(len(free_nodes), dtype=np.int32)
    rows, columns = _pairs(free_index[elements])
    kept = (rows >= 0) & (rows <= columns)
    keys = np.unique(rows[kept].astype(np.int64) * len(free_nodes) + columns[kept])
    block_rows, block_columns = np.divmod(keys, len(free_nodes))
    row = (3 * block_rows)[:, None, None] + np.arange(3)[None, :, None]
    column = (3 * block_columns)[:, None, None] + np.arange(3)[None, None, :]
    row, column = np.broadcast_arrays(row, column)
    flat_row, flat_column = row.reshape(-1), column.reshape(-1)
    upper = np.flatnonzero(flat_row <= flat_column)
    order = upper[np.lexsort((flat_column[upper], flat_row[upper]))]
    counts = np.bincount(flat_row[order], minlength=3 * len(free_nodes))
    return SparsePattern(
        free_nodes=free_nodes,
        free_index=free_index,
        block_count=len(keys),
        block_keys=keys,
        indptr=np.concatenate([[0], np.cumsum(counts)]).astype(np.int32),
        indices=flat_column[order].astype(np.int32),
        gather=order,
    )


def _pairs(nodes: IntArray) -> tuple[IntArray, IntArray]:
    rows = np.broadcast_to(nodes[:, :, None], (*nodes.shape, nodes.shape[1]))
    return rows, np.swapaxes(rows, 1, 2)
