"""A hard case: what is asked, how it is measured, and what came out; each in a process of its own.

If a case raises, hangs or crashes, it has failed, and the others go on.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess

from tacauchy_rig.tables import Table

Measured = dict[str, float | int | bool | str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What a case measured.

    Attributes:
        passed: The criterion is met.
        measured: Numbers, units in the names.
    """

    passed: bool
    measured: Measured


@dataclass(frozen=True, slots=True, kw_only=True)
class HardCase:
    """One row of the table.

    Attributes:
        measure: Runs the case; what it raises is a failed row.
        limit_s: Time after which it has failed [s].
    """

    number: int
    name: str
    criterion: str
    measure: Callable[[], Outcome]
    limit_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class CaseResult:
    """A row that was measured.

    Attributes:
        failure: Why there are no numbers: the error, or the time limit; empty otherwise.
    """

    number: int
    name: str
    criterion: str
    passed: bool
    measured: Measured = field(default_factory=dict)
    wall_s: float = 0.0
    failure: str = ""

    @property
    def verdict(self) -> str:
        """``pass`` or ``FAIL``."""
        return "pass" if self.passed else "FAIL"

    @property
    def table(self) -> Table:
        """What was measured, one line for each number; why nothing was, where nothing was."""
        return Table(
            title=f"{self.number}. {self.name}: {self.verdict}",
            columns=("measured", ""),
            rows=(("No numbers", self.failure),) if self.failure else tuple(self.measured.items()),
            criterion=self.criterion,
            passed=self.passed,
        )


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
