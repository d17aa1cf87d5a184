"""Fits side by side, each in a process of its own."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing.connection import wait
from threading import Thread
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def side_by_side(
    work: Callable[[Item], Result], items: Sequence[Item], *, jobs: int
) -> Iterator[Result]:
    """Yield what is made of every item, in their order.

    Args:
        work: Can be pickled, as items and results can; with one job it is called in this process.
        items: What to work on.
        jobs: Processes.
    """
    if jobs == 1 or len(items) < 2:
        yield from map(work, items)
        return
    spawn = multiprocessing.get_context("spawn")  # a fork would copy locks of threads
    with ProcessPoolExecutor(jobs, mp_context=spawn, initializer=_end_with_parent) as pool:
        yield from pool.map(work, items)


def _end_with_parent() -> None:
    """Let this process end when the one that waits for it is killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        Thread(target=_await_end, args=(parent.sentinel,), daemon=True).start()


def _await_end(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)
