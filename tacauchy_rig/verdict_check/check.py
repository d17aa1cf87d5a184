"""Which wrong models the verdict catches, by which criterion, and the smallest change of each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from reports.comparison.compare import compare
from reports.comparison.results import ValidationReport
from reports.evidence.evidence import RunEvidence
from tacauchy_rig.errors import ConvergenceError
from tacauchy_rig.verdict_check.bench import Bench
from tacauchy_rig.verdict_check.wrong_models import WrongModel

CANNOT = "cannot be replayed"

Missed = tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """What the verdict says of one wrong model.

    Attributes:
        caught_by: Criteria that it missed at its own size; empty where it passed.
        smallest: Smallest size that was caught; None for one that has no size, or where none was.
        smallest_by: Criteria that this one missed.
        passes_at: Largest size found that passes.
    """

    model: WrongModel
    caught_by: Missed
    smallest: float | None = None
    smallest_by: Missed = ()
    passes_at: float | None = None

    @property
    def caught(self) -> bool:
        """At its own size, or at a size that could be named."""
        return bool(self.caught_by) or self.smallest is not None


def missed_of(report: ValidationReport) -> Missed:
    """Return the names of all criteria that a run or any of its trials missed."""
    criteria = [*report.criteria, *(c for trial in report.trials for c in trial.criteria)]
    return tuple(dict.fromkeys(c.name for c in criteria if not c.passed))


def check_model(bench: Bench, model: WrongModel) -> Finding:
    """Look at a wrong model at its own size, and for the smallest size that is caught."""

    def missed_at(size: float) -> Missed:
        return _missed(lambda: model.evidence(bench, size))

    if model.size is None:
        return Finding(model=model, caught_by=missed_at(0.0))
    return search(model, missed_at)


def search(model: WrongModel, missed_at: Callable[[float], Missed]) -> Finding:
    """Double a size until it is caught, then halve the interval above the last that passes."""
    size = model.size or 0.0
    at_own_size = missed = missed_at(size)
    passes, caught = 0.0, size
    while not missed and caught < model.largest:
        passes, caught = caught, min(2.0 * caught, model.largest)
        missed = missed_at(caught)
    if not missed:
        return Finding(model=model, caught_by=(), passes_at=caught)
    for _ in range(model.halvings):
        middle = 0.5 * (passes + caught)
        found = missed_at(middle)
        if found:
            caught, missed = middle, found
        else:
            passes = middle
    return Finding(
        model=model,
        caught_by=at_own_size,
        smallest=caught,
        smallest_by=missed,
        passes_at=passes,
    )


def _missed(evidence: Callable[[], RunEvidence]) -> Missed:
    """Return what a wrong model misses; one that finds no equilibrium announces itself."""
    try:
        return missed_of(compare(evidence()))
    except ConvergenceError:
        return (CANNOT,)
