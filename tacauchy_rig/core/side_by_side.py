"""Work side by side, in processes of their own."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor
from concurrent.futures import wait as wait_for
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from threading import Thread
from typing import TypeVar

from tacauchy_rig.core.threads import take_one_thread

Item = TypeVar("Item")
Result = TypeVar("Result")

SPAWN = multiprocessing.get_context("spawn")
"""How processes are begun: a fork would copy locks of threads."""


def side_by_side(
    work: Callable[[Item], Result], items: Sequence[Item], *, jobs: int, afresh: bool = True
) -> Iterator[tuple[Item, Result]]:
    """Yield every item with what was made of it, in the order of the items.

    Args:
        work: Can be pickled, as items and results can; with one job it is called in this process.
        items: What to work on.
        jobs: Processes. Times of wall clocks are worth less where several share a processor.
        afresh: Begin a process for every item; else what one has loaded serves for more.
    """
    if jobs == 1 or len(items) < 2:
        for item in items:
            yield item, work(item)
        return
    with _processes(jobs, tasks_each=1 if afresh else None) as pool:
        begun: deque[tuple[Item, Future[Result]]] = deque()
        for item in items:
            # No more than there are processes: what waits in the pool would still begin after
            # Ctrl-C.
            while len(running := [future for _, future in begun if not future.done()]) >= jobs:
                wait_for(running, return_when=FIRST_COMPLETED)
            begun.append((item, pool.submit(work, item)))
            while begun and begun[0][1].done():
                yield _taken(begun)
        while begun:
            yield _taken(begun)


@contextmanager
def worker_process() -> Iterator[ProcessPoolExecutor]:
    """Give an executor with one process, which starts with the first work that it is given.

    An error, an interrupt included, ends the process: the program would wait for it otherwise.
    """
    with _processes(1, tasks_each=None) as pool:
        yield pool


@contextmanager
def _processes(jobs: int, *, tasks_each: int | None) -> Iterator[ProcessPoolExecutor]:
    """Give processes that end with an error here, also those that are only beginning."""
    theirs, ours = SPAWN.Pipe(duplex=False)
    pool = ProcessPoolExecutor(
        jobs,
        mp_context=SPAWN,
        max_tasks_per_child=tasks_each,
        initializer=begin_beside_others,
        initargs=(theirs,),
    )
    try:
        yield pool
    except BaseException:
        # What waits is told that the processes are gone; cancelled, it could not be.
        ours.close()
        pool.shutdown()
        raise
    pool.shutdown()


def _taken(begun: deque[tuple[Item, Future[Result]]]) -> tuple[Item, Result]:
    item, future = begun.popleft()
    return item, future.result()


def begin_beside_others(line: Connection | None = None) -> None:
    """Take one thread, since others compute beside this process, and end when its parent does.

    Args:
        line: End, too, when its other end is closed.
    """
    # Ctrl-C reaches all of a terminal's processes, and this one would only say where it waited.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    take_one_thread(solver_too=True)
    parent = multiprocessing.parent_process()
    if parent is not None:
        ends = [parent.sentinel, *([] if line is None else [line])]
        Thread(target=_await_end, args=(ends,), daemon=True).start()


def _await_end(ends: Sequence[int | Connection]) -> None:
    wait(ends)
    os._exit(1)
