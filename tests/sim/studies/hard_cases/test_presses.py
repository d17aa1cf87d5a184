"""Cases 14, 18 and 19: what they measure meets their criteria."""

from __future__ import annotations

import pytest

from sim.studies.hard_cases.invariants import (
    FORCE_ROUNDING,
    gives_nothing_back,
    no_contact,
    repeatable,
    slide_and_return,
)


def test_no_contact_is_exactly_nothing() -> None:
    """Case 14."""
    outcome = no_contact()
    assert outcome.passed
    assert outcome.measured["force_max_n"] == 0.0
    assert outcome.measured["iterations_before_touch"] == 0


def test_the_same_press_gives_the_same_force() -> None:
    """Case 19, within this process and against another, to the rounding of the sums.

    Not bit by bit: where MKL's arrays lie in memory may change the order in which it sums.
    """
    measured = repeatable().measured
    for where in ("same", "other"):
        assert float(measured[f"deviation_{where}_process_relative"]) <= FORCE_ROUNDING


def test_friction_takes_energy_out_at_every_point() -> None:
    """Case 18: no point gives any back, and all of them together take what the indenter put in."""
    slide = slide_and_return()
    assert gives_nothing_back(slide)
    assert slide["dissipated_j"] > 0.0
    assert slide["dissipated_j"] == pytest.approx(slide["work_less_stored_j"], rel=0.05)
    assert slide["balance_relative"] <= 1e-6
    assert slide["gap_min_m"] > 0.0
