"""The row of 80 % compression: its coarsest press, all the way."""

from __future__ import annotations

from sim.studies.hard_cases.materials import press_in


def test_rounded_cylinder_goes_down_by_four_fifths() -> None:
    """Every frame converges, the force rises, no element is turned inside out."""
    outcome = press_in("coarse", fillet_m=0.5e-3, bonded=True)
    assert outcome.passed, outcome.measured
    assert float(outcome.measured["min_jacobian_coarse"]) > 0.0
    assert float(outcome.measured["force_end_coarse_n"]) > 20.0
