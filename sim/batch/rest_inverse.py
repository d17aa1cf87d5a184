"""The inverse of the undeformed gel's stiffness, which serves every press on a sensor.

On a processor it is a sparse factor; columns at the surface are solved for when a node is touched
for the first time. On a GPU it is dense and made there: blocks of pivots are swept one after the
other (Goodnight 1979), each a product of two narrow matrices.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from sim.batch.inverses import DenseProduct, padded_rows, tiling
from sim.device import Device
from sim.solve.linear_solver import linear_solver
from sim.solve.model import Model
from tacauchy_rig.core.arrays import FloatArray, IntArray
from tacauchy_rig.core.errors import ConfigError

_BLOCK = 64
_WIDE = wp.constant(_BLOCK)
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
        whole = -(-size // _BLOCK) * _BLOCK
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
        device.launch(_block_at, self.compliance.shape, [inverse, flat], [self.compliance])
        self._tiling, self._device = tiling(count), device
        self.width, self.row_count = self._tiling.columns, padded_rows(size + 1)
        block_count = -(-count // self.width)
        self.blocks, self.column_count = (
            device.zeros(block_count, wp.int32),
            block_count * self.width,
        )
        # The largest entry of a positive definite matrix is on its diagonal.
        diagonal = device.zeros(size, wp.float32)
        device.launch(_diagonal_of, (size,), [inverse], [diagonal])
        self.unit = float(diagonal.numpy().max())
        self._matrices = device.zeros((1, self.row_count**2), wp.float16)
        shape = (self.row_count // 16, self.row_count // 32, 512)
        device.launch(_pack, shape, [inverse, size, shape[1], 1.0 / self.unit], [self._matrices])

    def need(self, nodes: IntArray) -> None:
        """Do nothing: all rows are known."""


def _dense(model: Model, whole: int, device: Device) -> Any:
    """Return the undeformed stiffness [N/m] as a dense matrix, with ones beyond its unknowns."""
    pattern = model.pattern
    matrix = device.zeros((whole, whole), wp.float32)
    diagonal = device.array(np.arange(pattern.dof_count, whole), wp.int32)
    if whole > pattern.dof_count:
        device.launch(_one_at, (whole - pattern.dof_count,), [diagonal], [matrix])
    rows = np.repeat(np.arange(pattern.dof_count), np.diff(pattern.indptr))
    values: FloatArray = model.rest_hessian_data()
    entries = [device.array(rows, wp.int32), device.array(pattern.indices, wp.int32)]
    entries.append(device.array(values, wp.float32))
    device.launch(_spread, (len(values),), entries, [matrix])
    return matrix


@wp.kernel(enable_backward=False)
def _one_at(places: wp.array(dtype=wp.int32), matrix: wp.array2d(dtype=wp.float32)):
    i = places[wp.tid()]
    matrix[i, i] = wp.float32(1.0)


@wp.kernel(enable_backward=False)
def _spread(
    rows: wp.array(dtype=wp.int32),
    columns: wp.array(dtype=wp.int32),
    values: wp.array(dtype=wp.float32),
    matrix: wp.array2d(dtype=wp.float32),
):
    k = wp.tid()
    matrix[rows[k], columns[k]] = values[k]
    matrix[columns[k], rows[k]] = values[k]


@wp.kernel(enable_backward=False)
def _block_at(
    inverse: wp.array2d(dtype=wp.float32),
    rows: wp.array(dtype=wp.int32),
    block: wp.array2d(dtype=wp.float32),
):
    i, j = wp.tid()
    if rows[i] >= 0 and rows[j] >= 0:
        block[i, j] = inverse[rows[i], rows[j]]


@wp.kernel(enable_backward=False)
def _diagonal_of(matrix: wp.array2d(dtype=wp.float32), diagonal: wp.array(dtype=wp.float32)):
    i = wp.tid()
    diagonal[i] = matrix[i, i]


@wp.kernel(enable_backward=False)
def _pack(
    matrix: wp.array2d(dtype=wp.float32),
    size: wp.int32,
    steps: wp.int32,
    scale: wp.float32,
    packed: wp.array2d(dtype=wp.float16),
):
    """Order a matrix as ``inverses.packed`` does: by row tile, step, half, lane and place."""
    tile, step, place = wp.tid()
    half = place / 256
    group = place / 32 % 8
    member = place / 8 % 4
    row = 16 * tile + 8 * (place / 2 % 2) + group
    column = 32 * step + 8 * member + 4 * half + 2 * (place / 4 % 2) + place % 2
    if row < size and column < size:
        at = (tile * steps + step) * 512 + place
        packed[0, at] = wp.float16(matrix[row, column] * scale)


def inverted(matrix: Any, device: Device) -> Any:
    """Invert a symmetric positive definite matrix in its place, shape [size, size].

    The size is a multiple of 64.
    """
    size = matrix.shape[0]
    count = size // _BLOCK
    pivot_inverse = device.zeros((_BLOCK, _BLOCK), wp.float32)
    column, along = (device.zeros((size, _BLOCK), wp.float32) for _ in range(2))
    threads = 256 if device.is_gpu else 1

    def blocks(kernel: Any, shape: tuple[int, ...], inputs: list[Any]) -> None:
        wp.launch(
            kernel, dim=(*shape, threads), inputs=inputs, block_dim=threads, device=device.name
        )

    for k in range(count):
        blocks(_invert_block, (1,), [matrix, k, pivot_inverse])
        blocks(_scale_column, (count,), [matrix, k, pivot_inverse, column, along])
        blocks(_update, (count, count), [column, along, pivot_inverse, k, matrix])
    device.launch(_negate, matrix.shape, [], [matrix])
    return matrix


@wp.kernel(enable_backward=False)
def _negate(matrix: wp.array2d(dtype=wp.float32)):
    i, j = wp.tid()
    matrix[i, j] = -matrix[i, j]


_SHARED = """
#if defined(__CUDA_ARCH__)
    #define SHARED __shared__
    #define SYNC __syncthreads()
    const int thread = threadIdx.x, threads = blockDim.x;
#else
    #define SHARED
    #define SYNC
    const int thread = 0, threads = 1;
#endif
"""
_INVERT = f"""
    {_SHARED}
    SHARED double a[BLOCK * BLOCK];
    SHARED double column[BLOCK];
    const size_t wide = matrix.shape[1], at = (size_t)k * BLOCK;
    for (int e = thread; e < BLOCK * BLOCK; e += threads)
        a[e] = matrix.data[(at + e / BLOCK) * wide + at + e % BLOCK];
    for (int p = 0; p < BLOCK; ++p) {{
        SYNC;
        for (int i = thread; i < BLOCK; i += threads) column[i] = a[i * BLOCK + p];
        SYNC;
        const double over = 1.0 / column[p];
        for (int e = thread; e < BLOCK * BLOCK; e += threads) {{
            const int i = e / BLOCK, j = e % BLOCK;
            if (i == p) a[e] = j == p ? -over : column[j] * over;
            else a[e] = j == p ? column[i] * over : a[e] - column[i] * over * column[j];
        }}
    }}
    SYNC;
    for (int e = thread; e < BLOCK * BLOCK; e += threads) out.data[e] = (float)-a[e];
    SYNC;
""".replace("BLOCK", str(_BLOCK))
# Of two tiles the product of one with the other's transpose; a thread has 16 entries of it.
_TILES = f"""
    {_SHARED}
    SHARED float l[BLOCK * (BLOCK + 1)];
    SHARED float r[BLOCK * (BLOCK + 1)];
    const size_t lefts = left.shape[1], rights = right.shape[1], wide = out.shape[1];
    for (int e = thread; e < BLOCK * BLOCK; e += threads) {{
        const int i = e / BLOCK, j = e % BLOCK;
        l[i * (BLOCK + 1) + j] = left.data[(left_row + i) * lefts + left_column + j];
        r[i * (BLOCK + 1) + j] = right.data[(right_row + i) * rights + j];
    }}
    SYNC;
    for (int e = thread; e < BLOCK * BLOCK / 16; e += threads) {{
        const int y = e / (BLOCK / 4) * 4, x = e % (BLOCK / 4);
        float sum[4][4] = {{}};
        for (int p = 0; p < BLOCK; ++p)
            for (int u = 0; u < 4; ++u)
                for (int v = 0; v < 4; ++v)
                    sum[u][v] += l[(y + u) * (BLOCK + 1) + p]
                        * r[(x + BLOCK / 4 * v) * (BLOCK + 1) + p];
        for (int u = 0; u < 4; ++u)
            for (int v = 0; v < 4; ++v) {{
                float& own = out.data[(out_row + y + u) * wide + out_column + x + BLOCK / 4 * v];
                own = sign * own + sum[u][v] * (sign == 0.f ? 1.f : -1.f);
            }}
    }}
    SYNC;
""".replace("BLOCK", str(_BLOCK))


@wp.func_native(_INVERT)
def _invert(
    matrix: wp.array2d(dtype=wp.float32), k: wp.int32, out: wp.array2d(dtype=wp.float32)
): ...


@wp.func_native(_TILES)
def _multiply(
    left: wp.array2d(dtype=wp.float32),
    left_row: wp.int32,
    left_column: wp.int32,
    right: wp.array2d(dtype=wp.float32),
    right_row: wp.int32,
    sign: wp.float32,
    out: wp.array2d(dtype=wp.float32),
    out_row: wp.int32,
    out_column: wp.int32,
):
    """Set a tile of ``out`` to a product, where ``sign`` is 0, or take the product off it."""


@wp.kernel(enable_backward=False, module="unique")
def _invert_block(
    matrix: wp.array2d(dtype=wp.float32), k: wp.int32, out: wp.array2d(dtype=wp.float32)
):
    _invert(matrix, k, out)


@wp.kernel(enable_backward=False, module="unique")
def _scale_column(
    matrix: wp.array2d(dtype=wp.float32),
    k: wp.int32,
    pivot: wp.array2d(dtype=wp.float32),
    column: wp.array2d(dtype=wp.float32),
    along: wp.array2d(dtype=wp.float32),
):
    """Copy a column of tiles, and multiply it with the pivot's inverse."""
    i, thread = wp.tid()
    at, size = i * _WIDE, _WIDE * _WIDE
    for e in range(thread, size, wp.block_dim()):
        column[at + e / _WIDE, e % _WIDE] = matrix[at + e / _WIDE, k * _WIDE + e % _WIDE]
    _multiply(matrix, at, k * _WIDE, pivot, 0, wp.float32(0.0), along, at, 0)


@wp.kernel(enable_backward=False, module="unique")
def _update(
    column: wp.array2d(dtype=wp.float32),
    along: wp.array2d(dtype=wp.float32),
    pivot: wp.array2d(dtype=wp.float32),
    k: wp.int32,
    matrix: wp.array2d(dtype=wp.float32),
):
    """Sweep a block of pivots: one block of threads has a tile."""
    i, j, thread = wp.tid()
    y, x = i * _WIDE, j * _WIDE
    if i == k or j == k:
        for e in range(thread, _WIDE * _WIDE, wp.block_dim()):
            p, q = e / _WIDE, e % _WIDE
            if i == k and j == k:
                matrix[y + p, x + q] = -pivot[p, q]
            elif j == k:
                matrix[y + p, x + q] = along[y + p, q]
            else:
                matrix[y + p, x + q] = along[x + q, p]
    else:
        _multiply(along, y, 0, column, x, wp.float32(1.0), matrix, y, x)
