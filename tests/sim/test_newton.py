"""When Newton ends: enough, at a harmless standstill, or out of iterations."""

from __future__ import annotations

import pytest

from sim.newton import stands_still


@pytest.mark.parametrize("rate", [0.5, 0.8, 0.9, 0.95, 0.98])
def test_linear_convergence_is_no_standstill(rate: float) -> None:
    """A residual that shrinks steadily, however slowly, is left to."""
    assert not any(stands_still([rate**k for k in range(n)]) for n in range(100))


@pytest.mark.parametrize("noise", [[1.0], [1.0, 2.0], [1.2, 0.95, 3.0], [1.0, 1.1, 0.92, 1.4]])
def test_noise_is_a_standstill(noise: list[float]) -> None:
    """A residual that goes up and down about one value stands still, after some iterations."""
    residuals = [1e6, 1e3, *(noise * 12)[:12]]
    assert any(stands_still(residuals[: n + 1]) for n in range(len(residuals)))


def test_a_rise_before_the_fall_is_no_standstill() -> None:
    """What comes to gain at last is left to."""
    assert not stands_still([1.0, 5.0, 9.0, 8.0, 6.0, 4.0, 2.0, 1.0, 0.5])
