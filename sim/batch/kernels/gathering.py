"""Who does what of a batch's work: threads, chunks of elements, unknowns and what adds up to them.

Elements and faces write what they contribute to places of their own, and every unknown adds up the
places that concern it, always in the same order: no two threads write to one place, and the same
press gives the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from sim.arrays import IntArray
from sim.device import Device, filled
from sim.mesh.sparsity import SparsePattern

# Shared memory is laid out for a multiple of so many unknowns: a few builds serve all meshes.
_WIDTH = 768
# So many environments leave multiprocessors idle, and each of them may have a larger block.
_FEW = 128
# Places are read so many at a time: one after the other, each would wait for the one before.
_AT_ONCE = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """What a kernel is built for; a block of threads has one environment.

    Attributes:
        threads: Of a block on a GPU; on the CPU it is one thread.
        chunk: Elements that go through shared memory at once; threads divide it or it them.
        resident: Blocks that a multiprocessor holds: the more, the fewer registers each.
        width: Unknowns that fit in shared memory.
    """

    threads: int
    chunk: int
    resident: int
    width: int


def evaluating(environment_count: int, unknown_count: int) -> Layout:
    """Return the layout of the forces: in float64 they fill shared memory and registers twice."""
    width = _width(unknown_count)
    if environment_count <= _FEW:
        return Layout(threads=512, chunk=512, resident=1, width=width)
    return Layout(threads=256, chunk=256, resident=2, width=width)


def searching(environment_count: int, unknown_count: int) -> Layout:
    """Return the layout of the steps of conjugate gradients."""
    width = _width(unknown_count)
    if environment_count <= _FEW:
        return Layout(threads=512, chunk=512, resident=1, width=width)
    return Layout(threads=256, chunk=512, resident=2, width=width)


def _width(unknown_count: int) -> int:
    """Return room for so many, and one more for what is fixed."""
    return -(-(unknown_count + 1) // _WIDTH) * _WIDTH


@wp.struct
class Gathering:
    """What adds up to the force on every unknown.

    Elements go through shared memory chunk by chunk; a chunk's contributions are numbered by nodal
    component first, then by element, and the place after them all holds a zero.

    Attributes:
        row_count: Unknowns.
        element_count: Elements.
        starts: Where an unknown's places begin in every chunk, shape [chunk_count, row_count + 1].
        places: Of contributions in their chunk, four at a time.
        contact_starts: Where an unknown's places begin, shape [row_count + 1].
        contact_places: Of contributions of faces that may be touched.
        vertical: 1 for unknowns along z, shape [row_count].
        tip_row: The unknown that is the indenter's lift [m] where it is pushed; -1 where its depth
            is given.
    """

    row_count: wp.int32
    element_count: wp.int32
    starts: wp.array2d(dtype=wp.int32)
    places: wp.array(dtype=wp.vec4i)
    contact_starts: wp.array(dtype=wp.int32)
    contact_places: wp.array(dtype=wp.int32)
    vertical: wp.array(dtype=wp.int32)
    tip_row: wp.int32


@dataclass(frozen=True, slots=True, kw_only=True)
class Numbering:
    """The unknowns of a pad and of its indenter.

    Attributes:
        rows: Unknown of every nodal component, shape [node_count, 3]; where it is fixed,
            ``row_count``: vectors have a row for it that stays zero.
        row_count: Unknowns.
        tip_row: The indenter's lift, or -1.
        vertical: Unknowns along z, shape [row_count].
    """

    rows: IntArray
    row_count: int
    tip_row: int
    vertical: NDArray[np.bool_]

    def of_nodes(self, nodes: IntArray) -> IntArray:
        """Return the unknowns of elements or faces: shape [3 * nodes of each, their number]."""
        return self.rows[nodes].reshape(len(nodes), -1).T

    def gathering(self, elements: IntArray, faces: IntArray, *, chunk: int, device: Device) -> Any:
        """Upload what adds up to the force on every unknown.

        Args:
            elements: Nodes of every element.
            faces: Nodes of every face that may be touched.
            chunk: Elements that go through shared memory at once.
        """
        starts, places = self._chunked_places(elements, chunk)
        contact_starts, contact_places = _places(self.of_nodes(faces).reshape(-1), self.row_count)
        return filled(
            Gathering,
            row_count=self.row_count,
            element_count=len(elements),
            starts=device.array(starts, wp.int32),
            places=device.array(places, wp.vec4i),
            contact_starts=device.array(contact_starts, wp.int32),
            contact_places=device.array(contact_places, wp.int32),
            vertical=device.array(self.vertical, wp.int32),
            tip_row=self.tip_row,
        )

    def _chunked_places(self, elements: IntArray, chunk: int) -> tuple[Any, Any]:
        """Return ``starts`` and ``places``."""
        idle = 3 * elements.shape[1] * chunk
        all_starts, all_places, before = [], [], 0
        for first in range(0, len(elements), chunk):
            rows = np.full((3 * elements.shape[1], chunk), self.row_count)
            here = self.of_nodes(elements[first : first + chunk])
            rows[:, : here.shape[1]] = here
            starts, places = _places(rows.reshape(-1), self.row_count)
            counts = np.diff(starts)
            groups = -(-counts // _AT_ONCE)
            group_starts = np.append(0, np.cumsum(groups))
            padded = np.full(_AT_ONCE * group_starts[-1], idle)
            of_place = np.repeat(np.arange(self.row_count), counts)
            shift = np.arange(len(places)) - starts[of_place]
            padded[_AT_ONCE * group_starts[of_place] + shift] = places
            all_starts.append(group_starts + before)
            all_places.append(padded.reshape(-1, _AT_ONCE))
            before += group_starts[-1]
        return np.stack(all_starts), np.concatenate(all_places)


def numbering(pattern: SparsePattern, *, is_pushed: bool) -> Numbering:
    """Number the unknowns; the indenter's lift is the last one where it is pushed."""
    row_count = pattern.dof_count + is_pushed
    rows = np.full(3 * len(pattern.block_row), row_count)
    rows[pattern.free_dofs] = np.arange(pattern.dof_count)
    return Numbering(
        rows=rows.reshape(-1, 3),
        row_count=row_count,
        tip_row=pattern.dof_count if is_pushed else -1,
        vertical=np.append(pattern.free_dofs % 3 == 2, [False] * is_pushed),
    )


def _places(rows: IntArray, row_count: int) -> tuple[Any, Any]:
    """Return where each of so many rows begins among places, and the places row by row."""
    order = np.argsort(rows, kind="stable")
    starts = np.searchsorted(rows[order], np.arange(row_count + 1))
    return starts, order[: starts[-1]]


# One load of 16 bytes, which Warp's own vectors are not aligned for.
@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const int4 four = ((const int4*)places.data)[i];
    return wp::vec_t<4, wp::int32>(four.x, four.y, four.z, four.w);
#else
    return places.data[i];
#endif
""")
def four_places(places: wp.array(dtype=wp.vec4i), i: wp.int32) -> wp.vec4i:  # type: ignore[empty-body]
    """Return four neighbouring places."""


@wp.func
def gathered(
    row: wp.int32, chunk: wp.int32, gathering: Gathering, contributions: Any
) -> wp.float64:
    """Return what an unknown's elements in a chunk add up to."""
    y = wp.float64(0.0)
    for i in range(gathering.starts[chunk, row], gathering.starts[chunk, row + 1]):
        p = four_places(gathering.places, i)
        pair = contributions[p[0]] + contributions[p[1]]
        y += wp.float64(pair + (contributions[p[2]] + contributions[p[3]]))
    return y


@wp.func
def gathered_contact(
    row: wp.int32, b: wp.int32, gathering: Gathering, face_forces: wp.array2d(dtype=wp.float64)
) -> wp.float64:
    """Return what an unknown's faces add up to."""
    y = wp.float64(0.0)
    for i in range(gathering.contact_starts[row], gathering.contact_starts[row + 1]):
        y += face_forces[b, gathering.contact_places[i]]
    return y


@wp.func
def wait_for_all(contributions: Any):
    """Let no thread write to shared memory before all have read what is there."""
    wp.tile_scatter_masked(contributions, 0, contributions.dtype(0.0), False)
