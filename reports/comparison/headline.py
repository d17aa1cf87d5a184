"""What counts of a run, and how its worst trial stands in it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from reports.comparison.model_criteria import (
    MARGIN,
    MODULUS,
    MODULUS_TRIALS,
    OFFSET,
    PREDICTION,
    RESIDUAL,
)
from reports.comparison.results import TrialResult
from tacauchy_rig.core.run import Criterion

COUNTS = (MARGIN, RESIDUAL, PREDICTION, OFFSET)
COUNTS_OF_RUN = (MODULUS, MODULUS_TRIALS)
"""Criteria that a wrong model can miss; what holds by construction is not among them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadlineRow:
    """One criterion over all trials.

    Attributes:
        worst: Of the trials; None where one of them has no value.
        met: Trials that met it, out of ``trials``.
    """

    name: str
    worst: float | None
    unit: str
    limit: str
    met: int
    trials: int

    @property
    def passed(self) -> bool:
        """Every trial met it."""
        return self.met == self.trials


def headline_of(
    trials: Sequence[TrialResult], run_criteria: Sequence[Criterion]
) -> tuple[HeadlineRow, ...]:
    """Return what counts: of the trials first, then of the run as a whole."""
    by_trial = [[c for t in trials for c in t.criteria if c.name == name] for name in COUNTS]
    of_run = [[c] for c in run_criteria if c.name in COUNTS_OF_RUN]
    return tuple(_row(found) for found in (*by_trial, *of_run) if found)


def worst_of(criteria: Sequence[Criterion]) -> Criterion:
    """Return the case of one criterion that is furthest off; one that has no value comes first."""

    def badness(criterion: Criterion) -> float:
        value = criterion.measured
        if math.isnan(value):
            return math.inf
        return -value if criterion.name == MARGIN else abs(value)

    return max(criteria, key=badness)


def _row(criteria: Sequence[Criterion]) -> HeadlineRow:
    worst = worst_of(criteria)
    alike = len({c.limit for c in criteria}) == 1
    return HeadlineRow(
        name=worst.name,
        worst=None if math.isnan(worst.measured) else worst.measured,
        unit=worst.unit,
        limit=worst.limit if alike else f"{worst.limit} (of that trial)",
        met=sum(c.passed for c in criteria),
        trials=len(criteria),
    )
