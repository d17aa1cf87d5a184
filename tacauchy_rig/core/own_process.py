"""Work in processes of their own: what hangs or crashes there takes nothing else along."""

from __future__ import annotations

import math
import os
import signal
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Any, Self, TypeVar

from tacauchy_rig.core.errors import RigError
from tacauchy_rig.core.side_by_side import SPAWN, begin_beside_others

Result = TypeVar("Result")

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
    begin_beside_others()
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
