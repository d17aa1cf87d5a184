"""Intervals and averages."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from reports.scores.metrics import psnr_of
from reports.scores.statistics import psnr_of_mean_mse, t_interval


def test_interval_of_six_values() -> None:
    """1..6: mean 3.5, deviation 1.8708, t(5) = 2.5706, so 3.5 +- 1.9633."""
    interval = t_interval([1, 2, 3, 4, 5, 6])
    assert interval.mean == 3.5
    assert interval.high == pytest.approx(3.5 + 1.9633, abs=1e-4)
    assert interval.low == pytest.approx(3.5 - 1.9633, abs=1e-4)


def test_interval_leaves_out_what_does_not_exist() -> None:
    """NaN and infinity do not count; one value has no interval, none has no mean."""
    assert t_interval([1.0, math.nan, 3.0, math.inf]).count == 2
    assert t_interval([2.0]).low is None
    assert t_interval([math.nan]).mean is None


@given(st.lists(st.floats(0.01, 1e4), min_size=1, max_size=8))
def test_psnr_of_mean_mse_never_exceeds_mean_of_psnrs(errors: list[float]) -> None:
    """Jensen: the two averages differ, and always in this direction."""
    assert psnr_of_mean_mse(errors) <= np.mean([psnr_of(e) for e in errors]) + 1e-9


def test_interval_covers_the_mean() -> None:
    """Of 2000 samples of six, 95 % of the intervals hold the true mean."""
    rng = np.random.default_rng(1)
    held = [
        interval.low <= 0.0 <= interval.high
        for interval in (t_interval(list(rng.normal(size=6))) for _ in range(2000))
        if interval.low is not None and interval.high is not None
    ]
    assert np.mean(held) == pytest.approx(0.95, abs=0.02)
