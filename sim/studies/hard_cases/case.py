"""A hard case: what is asked, how it is measured, and what came out; each in a process of its own.

If a case raises, hangs or crashes, it has failed, and the others go on.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from sim.studies.processes import OwnProcess, ProcessFailedError
from tacauchy_rig.core.tables import Table

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


def observe(case: HardCase) -> CaseResult:
    """Measure a case within its time limit; what it started is gone on return."""
    started, failure = time.monotonic(), ""
    try:
        with OwnProcess() as process:
            found = process.call(case.measure, limit_s=case.limit_s)
    except ProcessFailedError as error:
        found, failure = Outcome(passed=False, measured={}), error.message
    return CaseResult(
        number=case.number,
        name=case.name,
        criterion=case.criterion,
        passed=found.passed,
        measured=found.measured,
        wall_s=time.monotonic() - started,
        failure=failure,
    )
