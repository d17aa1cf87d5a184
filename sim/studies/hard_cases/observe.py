"""Run a hard case in a process of its own: if it raises, hangs or crashes, it is a failed row."""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess

from sim.studies.hard_cases.case import CaseResult, HardCase, Measured, Outcome

_GRACE_S = 5.0


def observe(case: HardCase) -> CaseResult:
    """Measure a case within its time limit; what it started is gone on return."""
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_measure, args=(case.measure, case.limit_s, sender))
    started = time.monotonic()
    process.start()
    sender.close()
    try:
        found = _await(receiver, process, case.limit_s)
    finally:
        _end(process)
        receiver.close()
    measured: Measured = {} if isinstance(found, str) else found.measured
    return CaseResult(
        number=case.number,
        name=case.name,
        criterion=case.criterion,
        passed=not isinstance(found, str) and found.passed,
        measured=measured,
        wall_s=time.monotonic() - started,
        failure=found if isinstance(found, str) else "",
    )


def _await(receiver: Connection, process: SpawnProcess, limit_s: float) -> Outcome | str:
    """Return what the case measured, or why it did not."""
    if not receiver.poll(limit_s):
        return f"not done after {limit_s:g} s"
    try:
        found: Outcome | str = receiver.recv()
    except EOFError:
        process.join(_GRACE_S)
        return f"its process ended with status {process.exitcode} and no result"
    return found


def _end(process: SpawnProcess) -> None:
    """Kill the case's process and those that it started."""
    if process.pid is not None:
        try:
            os.killpg(process.pid, signal.SIGKILL)
        except ProcessLookupError:  # it ended, or had no session of its own yet
            process.kill()
    process.join()


def _measure(measure: Callable[[], Outcome], limit_s: float, sender: Connection) -> None:
    os.setsid()
    # Where nobody is left to end a case that hangs, the kernel does.
    signal.alarm(math.ceil(limit_s + _GRACE_S))
    try:
        found: Outcome | str = measure()
    except Exception as error:  # noqa: BLE001 - this process's top: the row names the error
        found = f"{type(error).__name__}: {error}"
    sender.send(found)
