"""The first table of a report says what was asked, also where trials were asked other things."""

from __future__ import annotations

from types import SimpleNamespace

from reports.comparison.criteria import MODULUS, MODULUS_TRIALS, PREDICTION, headline_of
from tacauchy_rig.core.run import Criterion


def _criterion(name: str, measured: float, limit: str) -> Criterion:
    return Criterion(name=name, passed=False, measured=measured, limit=limit, unit="%")


def test_what_was_asked_of_the_worst_is_said() -> None:
    """A predicted force is asked to be within its own uncertainty, which differs."""
    of_run = (_criterion(MODULUS, 3.0, "within 5"), _criterion(MODULUS_TRIALS, 2.0, "3 or more"))
    assert [row.limit for row in headline_of((), of_run)] == ["within 5", "3 or more"]
    trials = [
        SimpleNamespace(criteria=(_criterion(PREDICTION, measured, f"within {limit}"),))
        for measured, limit in ((2.0, 8), (-9.0, 7), (4.0, 6))
    ]
    (row,) = headline_of(trials, ())
    assert (row.worst, row.limit) == (-9.0, "within 7 (of that trial)")
