"""A clamped pad's nodes, elements and touched faces, and the sparsity of its Newton matrix.

The sparsity is built once, filled by the kernels and read by the solver. Fixed degrees of freedom
are left out. Kernels add 3 x 3 blocks of the upper triangle; one gather turns them into the scalar
CSR data that solvers take.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from sim.mesh import elements as tetrahedra
from sim.mesh.cached_tet_mesh import TetMesh
from tacauchy_rig.core.arrays import FloatArray, IntArray
from tacauchy_rig.core.errors import ConfigError

AnyIntArray = NDArray[np.integer[Any]]
# Of the pad's height: what lies lower is on the clamped base.
_ON_BASE = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class SparsePattern:
    """Upper triangle of a symmetric matrix over the free degrees of freedom."""

    free_dofs: NDArray[np.int64]  # place of each unknown in the flat nodal vector, [dof_count]
    block_row: IntArray  # block row of each node, -1 where it is fixed, shape [node_count]
    block_keys: NDArray[np.int64]  # sorted row * row_count + column of each block, [block_count]
    indptr: IntArray  # CSR row starts, shape [dof_count + 1]
    indices: IntArray  # CSR columns, sorted, diagonal included
    gather: NDArray[np.int64]  # position of each CSR value in the flat blocks, shape [nnz]

    @property
    def dof_count(self) -> int:
        """Scalar unknowns."""
        return len(self.free_dofs)

    def slots(self, elements: IntArray) -> IntArray:
        """Return 2 * block index + transposed for each node pair, shape [n, k, k]; -1 for none."""
        rows, columns = _pairs(self.block_row[elements])
        index = np.searchsorted(self.block_keys, _keys(rows, columns, len(self.block_row)))
        slots = 2 * index + (rows > columns)
        return np.where((rows < 0) | (columns < 0), -1, slots).astype(np.int32)

    def upper(self, data: FloatArray) -> scipy.sparse.csr_matrix:
        """Return the upper triangle with CSR values."""
        return scipy.sparse.csr_matrix((data, self.indices, self.indptr), (self.dof_count,) * 2)

    def unknowns(self, nodal: FloatArray) -> FloatArray:
        """Return the free entries of a nodal vector [node_count, 3]."""
        return np.asarray(nodal.reshape(-1)[self.free_dofs])

    def nodal(self, unknowns: FloatArray) -> FloatArray:
        """Return unknowns as a nodal vector [node_count, 3], zero where fixed."""
        flat = np.zeros(3 * len(self.block_row))
        flat[self.free_dofs] = unknowns
        return flat.reshape(-1, 3)


def sparse_pattern(elements: IntArray, fixed: NDArray[np.bool_]) -> SparsePattern:
    """Build the pattern of a mesh of which degrees of freedom are fixed, shape [node_count, 3]."""
    moving = np.flatnonzero(~fixed.all(axis=1))
    block_row = np.full(len(fixed), -1, dtype=np.int32)
    block_row[moving] = np.arange(len(moving), dtype=np.int32)
    rows, columns = _pairs(block_row[elements])
    kept = (rows >= 0) & (rows <= columns)
    keys = np.sort(_keys(rows[kept], columns[kept], len(fixed)))
    block_keys = keys[np.diff(keys, prepend=-1) > 0]
    free_dofs = np.flatnonzero(~fixed.reshape(-1))
    unknown = np.full((len(fixed), 3), -1, dtype=np.int32)
    unknown.reshape(-1)[free_dofs] = np.arange(len(free_dofs))
    block_rows, block_columns = np.divmod(block_keys, len(fixed))
    row, column = np.broadcast_arrays(
        unknown[moving[block_rows]][:, :, None], unknown[moving[block_columns]][:, None, :]
    )
    flat_row, flat_column = row.reshape(-1), column.reshape(-1)
    upper = np.flatnonzero((flat_row >= 0) & (flat_row <= flat_column))
    # Blocks are sorted: by rows alone, columns stay so.
    entries = (upper, (flat_row[upper], flat_column[upper]))
    placed = scipy.sparse.csr_matrix(entries, (len(free_dofs),) * 2)
    return SparsePattern(
        free_dofs=free_dofs,
        block_row=block_row,
        block_keys=block_keys,
        indptr=placed.indptr,
        indices=placed.indices,
        gather=placed.data,
    )


def assembled(blocks: FloatArray, elements: AnyIntArray, size: int) -> scipy.sparse.csr_matrix:
    """Return the sum of blocks [element_count, k, k] at the rows of each, [element_count, k]."""
    rows, columns = (each.reshape(-1) for each in _pairs(elements))
    return scipy.sparse.csr_matrix((blocks.reshape(-1), (rows, columns)), shape=(size, size))


def _pairs(nodes: AnyIntArray) -> tuple[AnyIntArray, AnyIntArray]:
    rows = np.broadcast_to(nodes[:, :, None], (*nodes.shape, nodes.shape[1]))
    return rows, np.swapaxes(rows, 1, 2)


def _keys(rows: AnyIntArray, columns: AnyIntArray, stride: int) -> NDArray[np.int64]:
    low, high = np.minimum(rows, columns), np.maximum(rows, columns)
    return low.astype(np.int64) * stride + high


@dataclass(frozen=True, slots=True, kw_only=True)
class Discretisation:
    """What of a pad is fixed by its mesh and element type."""

    reference: tetrahedra.ReferenceElement
    nodes: FloatArray  # at rest [m], shape [node_count, 3]
    elements: IntArray  # nodes of every tetrahedron, its corners first
    # Nodes of every face that may be touched, its corners first: those on the surface, neither
    # clamped nor on a plane of symmetry
    faces: IntArray
    face_parents: IntArray
    clamped: NDArray[np.bool_]  # nodes on the base, shape [node_count]
    pattern: SparsePattern
    inverse_jacobians: FloatArray  # of the tetrahedra at rest [1/m], shape [element_count, 3, 3]
    volumes: FloatArray  # of the tetrahedra at rest [m^3]

    @property
    def face_areas(self) -> FloatArray:
        """Areas of the faces at rest [m^2], as if they were flat."""
        doubled = tetrahedra.doubled_areas(self.nodes, self.faces)
        return np.asarray(0.5 * np.linalg.norm(doubled, axis=1))

    @property
    def touched_element(self) -> int:
        """The tetrahedron behind the highest face: its layer is the one that is touched."""
        heights = self.nodes[self.faces[:, :3], 2].mean(axis=1)
        return int(self.face_parents[np.argmax(heights)])


def discretise(
    mesh: TetMesh, *, order: tetrahedra.ElementOrder, many_points: bool = False
) -> Discretisation:
    """Clamp a mesh at its base, give it an element type and, if asked, many contact points.

    Raises:
        ConfigError: A tetrahedron has no positive volume.
    """
    if order is tetrahedra.ElementOrder.P2:
        nodes, elements = tetrahedra.quadratic_nodes(mesh.vertices, mesh.tets)
    else:
        nodes, elements = mesh.vertices, mesh.tets
    faces, parents = tetrahedra.boundary_faces(elements)
    clamped = nodes[:, 2] <= _ON_BASE * mesh.vertices[:, 2].max()
    held = mesh.symmetry.on_plane(nodes, float(np.abs(mesh.vertices).max()))
    outer = ~clamped[faces[:, :3]].all(axis=1)
    outer &= ~np.any(held[faces[:, :3]].all(axis=1), axis=1)
    corners = nodes[elements[:, :4]]
    jacobians = np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)
    volumes = np.linalg.det(jacobians) / 6.0
    if volumes.min() <= 0.0:
        raise ConfigError(
            f"mesh has {int((volumes <= 0).sum())} tetrahedra of no positive volume",
            remedy="orient the tetrahedra or mesh the pad again",
        )
    return Discretisation(
        reference=tetrahedra.reference_element(order, many_points=many_points),
        nodes=nodes,
        elements=elements,
        faces=faces[outer],
        face_parents=parents[outer],
        clamped=clamped,
        pattern=sparse_pattern(elements, held | clamped[:, None]),
        inverse_jacobians=np.asarray(np.linalg.inv(jacobians), dtype=np.float64),
        volumes=volumes,
    )
