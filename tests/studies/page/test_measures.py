"""What is made of times and rates that were measured."""

from __future__ import annotations

import pytest

from tests.studies.page.command import Pairs, rate_table, reaction_table, stop_table

RATES = {
    "trial": 1,
    "outcome": "passed",
    "force [Hz]": 100.02,
    "lost force": 0,
    "images [Hz]": 18.74,
    "lost images": 0,
    "control loop, 99 % [ms]": 5.4,
}


def test_the_difference_is_that_of_pairs():
    """A machine that slows both down by as much changes nothing."""
    pairs = Pairs((12.0, 112.0, 53.0), (10.0, 110.0, 51.0))
    assert pairs.more_ms == pytest.approx((2.0, 0.0))


@pytest.mark.parametrize(("more_ms", "passed"), [(99.0, True), (-300.0, True), (101.0, False)])
def test_a_button_may_be_slower_by_so_much(more_ms, passed):
    """Quicker is no fault."""
    assert stop_table(Pairs((50.0 + more_ms,) * 2, (50.0,) * 2)).passed is passed


@pytest.mark.parametrize(("more_ms", "passed"), [(1.9, True), (-1.9, True), (2.1, False)])
def test_the_guard_has_to_be_as_quick(more_ms, passed):
    """Within two milliseconds."""
    assert reaction_table(Pairs((5.0 + more_ms,) * 2, (5.0,) * 2)).passed is passed


@pytest.mark.parametrize(
    ("change", "passed"),
    [
        ({}, True),
        ({"lost force": 1}, False),
        ({"lost images": 1}, False),
        ({"force [Hz]": 98.0}, False),
    ],
)
def test_nothing_may_be_lost(change, passed):
    """Not one sample, at the rates that were asked."""
    assert rate_table([RATES, {**RATES, **change}]).passed is passed
