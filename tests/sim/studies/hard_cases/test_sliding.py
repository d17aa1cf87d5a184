"""The rows of sliding and torsion, shorter."""

from __future__ import annotations

import pytest

from sim.studies.hard_cases.sliding import LIMIT_EXCESS, stick_slip, torsion


@pytest.mark.slow
def test_friction_keeps_its_limit_and_does_not_creep() -> None:
    """Two steps to and fro: the limit holds, and nothing moves while the indenter stands still."""
    measured = stick_slip(step_m=80e-6, step_count=2, hold_count=1).measured
    assert float(measured["excess_over_friction_limit_relative"]) <= LIMIT_EXCESS
    assert float(measured["creep_m"]) < float(measured["eps_v_dt_m"])
    assert float(measured["creep_held_still_m"]) < 1e-8


def test_first_part_of_the_torsion_is_smooth() -> None:
    """Thirty degrees of it."""
    outcome = torsion(turn_deg=30.0)
    assert outcome.passed, outcome.measured
    assert float(outcome.measured["torque_end_nm"]) > 2.5 * float(
        outcome.measured["torque_first_step_nm"]
    )
