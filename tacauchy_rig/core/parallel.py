"""Work in other processes: a parallel map, one worker, and a worker that may hang or crash."""

import math
import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor
from concurrent.futures import wait as wait_for
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from threading import Thread
from typing import Any, Self, TypeVar

from tacauchy_rig.core.errors import RigError
from tacauchy_rig.core.threads import take_one_thread

Item = TypeVar("Item")
Result = TypeVar("Result")

SPAWN = multiprocessing.get_context("spawn")
"""How processes are begun: a fork would copy locks of threads."""


def parallel_map(
    work: Callable[[Item], Result], items: Sequence[Item], *, jobs: int
) -> Iterator[tuple[Item, Result]]:
    """Yield every item with what was made of it, in the order of the items.

    Args:
        work: Can be pickled, as items and results can; with one job it is called in this process.
        jobs: Processes. Times of wall clocks are worth less where several share a processor.
    """
    if jobs == 1 or len(items) < 2:
        for item in items:
            yield item, work(item)
        return
    with _processes(jobs) as pool:
        started: deque[tuple[Item, Future[Result]]] = deque()
        for item in items:
            # No more than there are processes: what waits in the pool would still begin after
            # Ctrl-C.
            while len(running := [future for _, future in started if not future.done()]) >= jobs:
                wait_for(running, return_when=FIRST_COMPLETED)
            started.append((item, pool.submit(work, item)))
            while started and started[0][1].done():
                yield _next_result(started)
        while started:
            yield _next_result(started)


@contextmanager
def worker_process() -> Iterator[ProcessPoolExecutor]:
    """Give an executor with one process, which starts with the first work that it is given.

    An error, an interrupt included, ends the process: the program would wait for it otherwise.
    """
    with _processes(1) as pool:
        yield pool


@contextmanager
def _processes(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Give processes that end with an error here, also those that are only beginning."""
    theirs, ours = SPAWN.Pipe(duplex=False)
    pool = ProcessPoolExecutor(jobs, mp_context=SPAWN, initializer=begin_worker, initargs=(theirs,))
    try:
        yield pool
    except BaseException:
        # What waits is told that the processes are gone; cancelled, it could not be.
        ours.close()
        pool.shutdown()
        raise
    pool.shutdown()


def _next_result(started: deque[tuple[Item, Future[Result]]]) -> tuple[Item, Result]:
    item, future = started.popleft()
    return item, future.result()


def begin_worker(line: Connection | None = None) -> None:
    """Take one thread, since other workers share the processor, and end when its parent does.

    Args:
        line: End, too, when its other end is closed.
    """
    # Ctrl-C reaches all of a terminal's processes, and this one would only say where it waited.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    take_one_thread(solver_too=True)
    parent = multiprocessing.parent_process()
    if parent is not None:
        ends = [parent.sentinel, *([] if line is None else [line])]
        Thread(target=_end_with, args=(ends,), daemon=True).start()


def _end_with(ends: Sequence[int | Connection]) -> None:
    wait(ends)
    os._exit(1)


_GRACE_S = 5.0


class ProcessFailedError(RigError):
    """A process gave no result: its function raised, took too long, or ended the process."""


class IsolatedWorker:
    """A process that calls functions, one after the other; what one has loaded the next finds.

    A process that has crashed, or was ended because it took too long, is followed by another. On
    leaving, it is gone with all that it started.
    """

    def __init__(self) -> None:
        self._running: tuple[Connection, SpawnProcess] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def call(self, function: Callable[[], Result], *, limit_s: float) -> Result:
        """Return what a function gives that the other process can import.

        Raises:
            ProcessFailedError: There is no result after so much time [s].
        """
        calls, process = self._running = self._running or _started()
        try:
            calls.send((function, limit_s))
            if not calls.poll(limit_s):
                self.end()
                raise ProcessFailedError(f"not done after {limit_s:g} s")
            result, failure = calls.recv()
        except (EOFError, OSError) as error:
            process.join(_GRACE_S)
            self.end()
            raise ProcessFailedError(
                f"its process ended with status {process.exitcode} and no result"
            ) from error
        if failure:
            raise ProcessFailedError(failure)
        found: Result = result
        return found

    def end(self) -> None:
        """Kill the process and those that it started; the next call starts another."""
        if self._running is None:
            return
        calls, process = self._running
        self._running = None
        calls.close()
        try:
            os.killpg(process.pid or 0, signal.SIGKILL)
        except ProcessLookupError:  # it ended, or had no session of its own yet
            process.kill()
        process.join()


def _started() -> tuple[Connection, SpawnProcess]:
    ours, theirs = SPAWN.Pipe()
    process = SPAWN.Process(target=_serve, args=(theirs,))
    process.start()
    theirs.close()
    return ours, process


def _serve(calls: Connection) -> None:
    os.setsid()
    begin_worker()
    while True:
        try:
            function, limit_s = calls.recv()
        except EOFError:
            return
        # Where nobody is left to end a function that hangs, the kernel does.
        signal.alarm(math.ceil(limit_s + _GRACE_S))
        answer: tuple[Any, str]
        try:
            answer = function(), ""
        except RigError as error:
            answer = None, error.message
        except Exception as error:  # noqa: BLE001 - this process's top: the answer names the error
            answer = None, f"{type(error).__name__}: {error}"
        signal.alarm(0)
        calls.send(answer)
