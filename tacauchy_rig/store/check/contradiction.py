"""A check's outcome as a criterion: what had to agree, and what does not."""

from __future__ import annotations

from collections.abc import Iterable

from tacauchy_rig.run import Criterion

TRIAL = "TRIAL"
"""In a remedy, where the trial's number goes."""

SET_ASIDE = (
    "the file was edited, exchanged or damaged after it was written. "
    f"`tacauchy-rig resume RUN --again {TRIAL}` presses the trial once more"
)
_TOLD = 3
"""Contradictions that are written out; one edit often breaks many lines."""


def agreement(
    name: str, promise: str, contradictions: Iterable[str], *, remedy: str = SET_ASIDE
) -> Criterion:
    """Return a criterion that is met where nothing contradicts a promise.

    Args:
        name: Of the criterion, such as ``recording_hash``.
        promise: What has to hold, in words.
        contradictions: Each names the file and both values.
        remedy: What to do where it does not hold.
    """
    found = list(contradictions)
    told = "; ".join(found[:_TOLD])
    more = f"; and {len(found) - _TOLD} more" if len(found) > _TOLD else ""
    return Criterion(
        name=name,
        passed=not found,
        measured=float(len(found)),
        limit=f"{promise}; but {told}{more}" if found else promise,
        unit="wrong",
        remedy=remedy if found else "",
    )
