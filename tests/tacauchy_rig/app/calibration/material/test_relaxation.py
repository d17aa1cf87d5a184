"""A dwell that relaxes is told from one that does not."""

from __future__ import annotations

import numpy as np
import pytest

from tacauchy_rig.app.calibration.material.results import fit_term

TIME_S = np.tile(np.linspace(0.0, 2.0, 200), 6)
NOISE = 0.002 * np.random.default_rng(3).standard_normal(len(TIME_S))


def test_share_and_time_are_found() -> None:
    """3 % in 0.4 s, under noise of 0.2 %."""
    found = fit_term(TIME_S, 1.0 + 0.03 * np.exp(-TIME_S / 0.4) + NOISE)
    assert found is not None
    assert found.share == pytest.approx(0.03, abs=3.0 * found.share_error)
    assert found.time_s == pytest.approx(0.4, abs=3.0 * found.time_error_s)
    assert found.share_error < 0.002


@pytest.mark.parametrize("rising", [0.0, 0.005])
def test_noise_and_a_rising_force_tell_none(rising: float) -> None:
    """A servo that still pushes is no relaxation."""
    assert fit_term(TIME_S, 1.0 + rising * TIME_S + NOISE) is None
    assert fit_term(TIME_S[:5], np.ones(5)) is None
