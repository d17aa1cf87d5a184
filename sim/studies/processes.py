"""Work in processes of their own: what hangs or crashes there takes nothing else along."""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor
from concurrent.futures import wait as wait_for
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from threading import Thread
from typing import Any, Self, TypeVar

from tacauchy_rig.errors import RigError
from tacauchy_rig.threads import take_one_thread

Item = TypeVar("Item")
Result = TypeVar("Result")

_CONTEXT = multiprocessing.get_context("spawn")
_GRACE_S = 5.0


class ProcessFailedError(RigError):
    """A process gave no result: its function raised, took too long, or ended the process."""


class OwnProcess:
    """A process that calls functions, one after the other; what one has loaded the next finds.

    A process that has crashed, or was ended because it took too long, is followed by another. On
    leaving, it is gone with all that it started.
    """

    def __init__(self) -> None:
        self._running: tuple[Connection, SpawnProcess] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def call(self, function: Callable[[], Result], *, limit_s: float) -> Result:
        """Return what a function gives that the other process can import.

        Raises:
            ProcessFailedError: There is no result after so much time [s].
        """
        calls, process = self._running = self._running or _started()
        try:
            calls.send((function, limit_s))
            if not calls.poll(limit_s):
                self._end()
                raise ProcessFailedError(f"not done after {limit_s:g} s")
            result, failure = calls.recv()
        except (EOFError, OSError) as error:
            process.join(_GRACE_S)
            self._end()
            raise ProcessFailedError(
                f"its process ended with status {process.exitcode} and no result"
            ) from error
        if failure:
            raise ProcessFailedError(failure)
        found: Result = result
        return found

    def _end(self) -> None:
        """Kill the process and those that it started."""
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
    ours, theirs = _CONTEXT.Pipe()
    process = _CONTEXT.Process(target=_serve, args=(theirs,))
    process.start()
    theirs.close()
    return ours, process


def _serve(calls: Connection) -> None:
    os.setsid()
    _begin()
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
        except Exception as error:  # noqa: BLE001 - this process's top: the answer names the error
            answer = None, f"{type(error).__name__}: {error}"
        signal.alarm(0)
        calls.send(answer)


def side_by_side(
    measure: Callable[[Item], Result], items: Sequence[Item], *, jobs: int
) -> Iterator[tuple[Item, Result]]:
    """Yield every item with what was measured for it, in the order of the items.

    Args:
        measure: A function of a module, since it is run in another process; with one job in this.
        items: Whatever can be sent to another process, such as names.
        jobs: Processes. Times of wall clocks are worth less where several share a processor.
    """
    if jobs == 1 or len(items) < 2:
        for item in items:
            yield item, measure(item)
        return
    with ProcessPoolExecutor(
        jobs, mp_context=_CONTEXT, max_tasks_per_child=1, initializer=_begin
    ) as pool:
        begun: deque[tuple[Item, Future[Result]]] = deque()
        for item in items:
            # No more than there are processes: what waits in the pool would still begin after
            # Ctrl-C.
            while len(running := [future for _, future in begun if not future.done()]) >= jobs:
                wait_for(running, return_when=FIRST_COMPLETED)
            begun.append((item, pool.submit(measure, item)))
            while begun and begun[0][1].done():
                yield _taken(begun)
        while begun:
            yield _taken(begun)


def _taken(begun: deque[tuple[Item, Future[Result]]]) -> tuple[Item, Result]:
    item, future = begun.popleft()
    return item, future.result()


def _begin() -> None:
    """Take one thread, since others compute beside this process, and end when its parent does."""
    take_one_thread(solver_too=True)
    parent = multiprocessing.parent_process()
    if parent is not None:
        Thread(target=_await_end, args=(parent.sentinel,), daemon=True).start()


def _await_end(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)
