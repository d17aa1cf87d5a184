"""A hard case: what is asked, how it is measured, and what came out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

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
    limit_s: float = 120.0


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
