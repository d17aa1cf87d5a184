"""Independent measurements in processes of their own, reported in the order they were asked for."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing.connection import wait
from threading import Thread
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
    with ProcessPoolExecutor(
        jobs, mp_context=context, max_tasks_per_child=1, initializer=_end_with_parent
    ) as pool:
        pending = [(name, pool.submit(measure, name)) for name in names]
        for name, future in pending:
            yield name, future.result()


def _end_with_parent() -> None:
    """Let a process that measures end when the one that waits for it is killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        Thread(target=_await_end, args=(parent.sentinel,), daemon=True).start()


def _await_end(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)
