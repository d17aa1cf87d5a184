"""Whether friction and lean are worth simulating: the table's verdict."""

from __future__ import annotations

import pytest

from tests.studies.mounting.command import FOUND, SMOOTH, UPRIGHT, Residuals, residual_table


def _trial(index: int, found: float | None, smooth: float | None) -> Residuals:
    return Residuals(trial=index, force_n=1.0, left={FOUND: found, UPRIGHT: 0.2, SMOOTH: smooth})


@pytest.mark.parametrize(("worse", "passed"), [(0, True), (1, True), (2, False)])
def test_five_of_six_have_to_be_better(worse: int, passed: bool) -> None:
    """One trial may come out the other way by noise, two not."""
    trials = [_trial(k, 0.3 if k < worse else 0.1, 0.2) for k in range(6)]
    table = residual_table(trials)
    assert table.passed is passed
    assert len(table.rows) == 6


def test_what_shows_no_contact_is_no_better() -> None:
    """Nothing passes without a value, and nothing passes without a trial."""
    assert not residual_table([_trial(1, None, 0.2)]).passed
    assert not residual_table([_trial(1, 0.1, None)]).passed
    assert not residual_table([]).passed
