"""Criteria that were missed, told to the operator: one line each on standard error."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from tacauchy_rig.run import Criterion, Outcome, TrialRecord

MISSED = "missed: "


def missed_lines(records: Sequence[TrialRecord]) -> Iterator[str]:
    """Yield a line for each criterion that the last attempt at a trial missed.

    It names the trial, the criterion, what was measured, what was asked, and what to do.
    """
    for record in records:
        if record.outcome is not Outcome.FAILED:
            continue
        tries = f", attempt {record.attempt}" if record.attempt > 1 else ""
        for criterion in record.criteria:
            if not criterion.passed:
                yield f"{MISSED}trial {record.index}{tries}: {_told(criterion)}"


def _told(criterion: Criterion) -> str:
    measured = f"{criterion.measured:.4g} {criterion.unit}".rstrip()
    text = f"{criterion.name} is {measured}, asked: {criterion.limit}"
    return f"{text} -> {criterion.remedy}" if criterion.remedy else text
