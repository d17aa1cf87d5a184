"""The mock gel is a standard linear solid."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.mock.world import Gel


def test_a_step_relaxes_by_the_fraction_with_the_time_constant():
    """F(t) = k d (1 - r (1 - exp(-t / tau))) after a step, the solid's closed solution."""
    gel = Gel(stiffness_n_m=2000.0, relaxed_fraction=0.1, relaxation_time_s=2.0)
    assert gel.press(0.001, duration_s=0.0) == pytest.approx(2.0)
    for step in range(1, 5):
        expected = 2.0 * (1 - 0.1 * (1 - math.exp(-step / 2.0)))
        assert gel.press(0.001, duration_s=1.0) == pytest.approx(expected)


@given(st.lists(st.floats(-0.002, 0.002), min_size=1, max_size=50))
def test_it_never_pulls_and_lets_go_above_the_surface(depths):
    """Whatever the history, the force is no tension, and zero out of contact."""
    gel = Gel()
    for depth_m in depths:
        force_n = gel.press(depth_m, duration_s=0.01)
        assert force_n >= 0.0
        if depth_m <= 0.0:
            assert force_n == 0.0
