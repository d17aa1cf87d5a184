"""What is made of times and rates that were measured."""

from __future__ import annotations

import pytest

from tests.studies.page.command import Pairs, rate_table, reaction_table

RATES = {
    "trial": 1,
    "outcome": "passed",
    "force [Hz]": 100.02,
    "lost force": 0,
    "images [Hz]": 18.74,
    "lost images": 0,
    "control loop, 99 % [ms]": 5.4,
}


@pytest.mark.parametrize(("more_ms", "passed"), [(1.9, True), (-1.9, True), (2.1, False)])
def test_the_guard_has_to_be_as_quick(more_ms, passed):
    """Within two milliseconds."""
    assert (
        reaction_table(Pairs((5.0 + more_ms,) * 2, (5.0,) * 2), "with", "without").passed is passed
    )


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
