"""The arm's own estimate: what its tolerance must hold, going by stand-ins of arms."""

from __future__ import annotations

import math

import pytest

from drivers.emulators.force_estimate import COARSENESS, ForceEstimate
from protocols.guard.witness import TOLERANCE, WINDOW_S, ArmEstimate
from tacauchy_rig.core.config.model import RobotModel
from tests.protocols.conftest import arm_state

TRIAL_S = 50.0


def test_without_an_estimate_or_a_zero_nothing_is_felt():
    """None is no zero newton."""
    estimate = ArmEstimate(RobotModel.CB3)
    estimate.take([arm_state()])
    estimate.zero()
    assert estimate.force_n is None
    estimate.take([arm_state(stamp_s=0.1, force_n=3.0)])
    assert estimate.force_n is None


def test_the_force_is_a_mean_less_the_zero():
    """3 N of offset, then 2 N of force; older states are forgotten."""
    estimate = ArmEstimate(RobotModel.E_SERIES)
    estimate.take([arm_state(stamp_s=0.0, force_n=2.5), arm_state(stamp_s=0.1, force_n=3.5)])
    estimate.zero()
    estimate.take([arm_state(stamp_s=1.0, force_n=4.0), arm_state(stamp_s=1.1, force_n=6.0)])
    assert estimate.force_n == pytest.approx(2.0)


def test_a_controller_may_count_a_push_the_other_way():
    """The zero is turned with it: 3 N of offset, then 2 N of force."""
    estimate = ArmEstimate(RobotModel.E_SERIES, sign=-1)
    estimate.take([arm_state(stamp_s=0.0, force_n=-3.0)])
    estimate.zero()
    estimate.take([arm_state(stamp_s=1.0, force_n=-5.0)])
    assert estimate.force_n == pytest.approx(2.0)


@pytest.mark.parametrize("model", RobotModel)
def test_the_tolerance_holds_five_deviations_of_what_an_arm_does(model):
    """Noise of a mean, friction that turns round, gain, and two deviations of a trial's drift."""
    coarse, tolerance = COARSENESS[model], TOLERANCE[model]
    noise_n = coarse.noise_n * math.sqrt(2.0 * coarse.noise_time_s / WINDOW_S)
    assert tolerance.share >= 5.0 * coarse.gain_ratio
    drift_n = coarse.drift_n_s * TRIAL_S
    assert tolerance.force_n >= 5.0 * math.hypot(noise_n, drift_n) + 2.0 * coarse.friction_n


@pytest.mark.parametrize("seed", range(5))
def test_an_e_series_arm_stays_within_its_tolerance(seed):
    """50 s at 5 N with noise, drift and gain: no mean is further off than allowed."""
    model = RobotModel.E_SERIES
    coarse, watched = ForceEstimate(model, seed=seed), ArmEstimate(model)
    period_s, force_n = 1.0 / model.rate_hz, 0.0
    for number in range(round(TRIAL_S / period_s)):
        felt = coarse.advance((0.0, 0.0, force_n, 0.0, 0.0, 0.0), (0.0,) * 6, duration_s=period_s)
        watched.take([arm_state(stamp_s=number * period_s, force_n=felt[2])])
        if number * period_s == 1.0:
            watched.zero()
            force_n = 5.0
        if number * period_s > 1.0 + WINDOW_S:
            assert abs(watched.force_n - force_n) < watched.tolerance.of(force_n)
