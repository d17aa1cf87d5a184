"""How the threads and the shared memory of a GPU are shared out among environments."""

from __future__ import annotations

from dataclasses import dataclass

# Shared memory is laid out for a multiple of so many unknowns: a few builds serve all meshes.
_WIDTH = 768
# So many environments leave multiprocessors idle, and each of them may have a larger block.
_FEW = 128


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
