"""The relaxation recursion against the convolution that it stands for."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.emulators.plant.gel.relaxation import Relaxation

WEIGHTS, TIMES = (0.03, 0.04), (0.3, 3.0)


@given(st.lists(st.tuples(st.floats(0.5, 5.0), st.floats(0.001, 2.0)), min_size=1, max_size=12))
def test_recursion_is_the_convolution(steps: list[tuple[float, float]]) -> None:
    """For forces that are linear between samples both agree to rounding."""
    force = np.array([0.0] + [value for value, _ in steps])
    time = np.concatenate([[0.0], np.cumsum([duration for _, duration in steps])])
    relaxation = Relaxation(WEIGHTS, TIMES)
    found = [relaxation.advance(value, duration) for value, duration in steps][-1]
    expected = force[-1]
    for weight, tau in zip(WEIGHTS, TIMES, strict=True):
        decay = np.exp((time - time[-1]) / tau)
        # integral of exp((s - t) / tau) dF/ds over each straight piece
        expected += weight * np.sum(np.diff(force) / np.diff(time) * tau * np.diff(decay))
    assert found == pytest.approx(max(0.0, expected), rel=1e-9, abs=1e-9)


def test_a_step_relaxes_to_the_long_term_force() -> None:
    """A sudden press feels all weights at once and loses them with their times."""
    relaxation = Relaxation(WEIGHTS, TIMES)
    assert relaxation.advance(2.0, 0.0) == pytest.approx(2.0 * 1.07)
    assert relaxation.advance(2.0, 60.0) == pytest.approx(2.0, rel=1e-6)


def test_no_force_out_of_contact_whatever_was_before() -> None:
    """Gel that has not yet risen does not pull."""
    relaxation = Relaxation(WEIGHTS, TIMES)
    relaxation.advance(4.0, 1.0)
    assert relaxation.advance(0.0, 0.01) == 0.0
    assert relaxation.advance(0.0, 0.01) == 0.0


def test_unloading_leaves_less_than_loading() -> None:
    """At the same depth the force is lower on the way out: the loop loses energy."""
    relaxation = Relaxation(WEIGHTS, TIMES)
    way_in = [relaxation.advance(0.1 * i, 0.1) for i in range(1, 21)]
    way_out = [relaxation.advance(0.1 * i, 0.1) for i in range(19, 0, -1)]
    assert all(out < into for into, out in zip(way_in[-2::-1], way_out, strict=True))
