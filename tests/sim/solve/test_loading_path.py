"""Phases of a path: what they reach, in what steps, and how they turn the indenter."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.solve.stepping import CarryPhase, ForcePhase, Phase


def _carried(twist_rad: float, *, load_n: float | None = None) -> CarryPhase:
    return CarryPhase(
        goal="there",
        shift_m=np.array([3e-4, 4e-4, 0.0]),
        twist_rad=twist_rad,
        load_n=load_n,
        radius_m=2e-3,
        step_max_m=5e-5,
    )


@given(twist=st.floats(-3.0, 3.0), parts=st.integers(1, 7))
def test_turns_add_up_to_the_twist(twist: float, parts: int) -> None:
    """In any number of steps the rotation stays one, and ends at the whole angle about z."""
    phase, rotation = _carried(twist), np.eye(3)
    for _ in range(parts):
        rotation = phase.turned(rotation, 1.0 / parts)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    assert np.arctan2(rotation[1, 0], rotation[0, 0]) == pytest.approx(twist, abs=1e-14)


def test_a_step_carries_no_point_farther_than_allowed() -> None:
    """Centre and rim together: |shift| + angle r times the longest step is the largest way."""
    phase = _carried(0.5)
    assert phase.longest(1e3) * (5e-4 + 0.5 * 2e-3) == pytest.approx(5e-5)
    assert phase.load_at(0.3) is None
    assert _carried(0.5, load_n=2.0).load_at(0.3) == 2.0


def test_depth_and_force_go_straight_down() -> None:
    """A newton takes 1/k of way; both ends are met to their rounding."""
    depth = Phase(goal="1 mm", start=0.0, end=1e-3, exact=1e-14, step_max_m=5e-5)
    force = ForcePhase(goal="2 N", start=0.0, end=2.0, exact=2e-12, step_max_m=5e-5)
    np.testing.assert_array_equal(depth.rate(400.0)[0], [0.0, 0.0, -1.0])
    np.testing.assert_allclose(force.rate(400.0)[0], [0.0, 0.0, -1.0 / 400.0])
    assert force.longest(400.0) == pytest.approx(400.0 * 5e-5)
    assert force.load_at(1.5) == 1.5
    assert depth.is_short_of(1e-3 - 1e-12)
    assert not depth.is_short_of(1e-3 + 1e-15)
