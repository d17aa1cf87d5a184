"""Independent measurements in processes of their own, reported in the order they were asked for."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Annotated, TypeVar

import typer

Result = TypeVar("Result")

Jobs = Annotated[
    int,
    typer.Option(
        "--jobs", metavar="N", min=1, help="How many to run at once, each in a process of its own."
    ),
]


def side_by_side(
    measure: Callable[[str], Result], names: Sequence[str], *, jobs: int
) -> Iterator[tuple[str, Result]]:
    """Yield every name with what was measured for it.

    Args:
        measure: A function of a module, since it is run in another process; with one job in this.
        jobs: Processes. Times of wall clocks are worth less where several share a processor.
    """
    if jobs == 1 or len(names) < 2:
        for name in names:
            yield name, measure(name)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context, max_tasks_per_child=1) as pool:
        pending = [(name, pool.submit(measure, name)) for name in names]
        for name, future in pending:
            yield name, future.result()
