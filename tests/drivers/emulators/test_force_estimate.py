"""An arm's own estimate of force is as coarse as it is said to be, and no finer."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.emulators.force_estimate import COARSENESS, ForceEstimate
from tacauchy_rig.core.config.model import RobotModel
from tacauchy_rig.core.run import Vector6

STILL: Vector6 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
DOWN: Vector6 = (0.0, 0.0, -1e-3, 0.0, 0.0, 0.0)
PRESSED: Vector6 = (0.0, 0.0, 5.0, 0.0, 0.0, 0.0)


def _fz(estimate: ForceEstimate, model: RobotModel, velocity: Vector6, *, wrench: Vector6 = STILL):
    """Return F_z over a second [N]."""
    period_s = 1.0 / model.rate_hz
    count = round(model.rate_hz)
    samples = [estimate.advance(wrench, velocity, duration_s=period_s) for _ in range(count)]
    return np.array(samples)[:, 2]


@pytest.mark.parametrize("model", list(RobotModel))
def test_zeros_lie_within_two_deviations_and_noise_is_as_stated(model: RobotModel) -> None:
    """Over 200 arms: no zero beyond its bound, some beyond half of it, noise as stated."""
    stated = COARSENESS[model]
    runs = [_fz(ForceEstimate(model, seed=seed), model, STILL) for seed in range(200)]
    zeros = np.abs([run.mean() for run in runs])
    assert np.max(zeros) < 2.0 * stated.offset_n + stated.noise_n
    assert np.max(zeros) > 1.5 * stated.offset_n
    assert np.mean([run.std() for run in runs]) == pytest.approx(stated.noise_n, rel=0.1)


@pytest.mark.parametrize("model", list(RobotModel))
def test_a_press_shows_as_a_rise(model: RobotModel) -> None:
    """5 N more on a tool that moves on reads 5 N more, within the gain and the noise's mean."""
    estimate = ForceEstimate(model, seed=4)
    before = _fz(estimate, model, DOWN).mean()
    before = _fz(estimate, model, DOWN).mean()
    risen = _fz(estimate, model, DOWN, wrench=PRESSED).mean() - before
    assert risen == pytest.approx(5.0, abs=5.0 * 2 * COARSENESS[model].gain_ratio + 0.35)


def test_friction_of_a_cb3_turns_with_the_motion_and_stays_at_rest() -> None:
    """Down, then up: the estimate falls by the whole band of friction; at rest it stays."""
    model = RobotModel.CB3
    estimate = ForceEstimate(model, seed=1)
    up: Vector6 = (0.0, 0.0, 1e-3, 0.0, 0.0, 0.0)
    down = [_fz(estimate, model, DOWN).mean() for _ in range(2)][-1]
    rest = _fz(estimate, model, STILL).mean()
    lifted = [_fz(estimate, model, up).mean() for _ in range(2)][-1]
    assert rest == pytest.approx(down, abs=0.5)
    assert down - lifted == pytest.approx(2.0 * COARSENESS[model].friction_n, abs=0.6)


@pytest.mark.parametrize("model", list(RobotModel))
def test_a_zero_takes_the_offset_away(model: RobotModel) -> None:
    """What it read then is subtracted, noise and all; a press after it reads from there."""
    estimate = ForceEstimate(model, seed=2)
    before = _fz(estimate, model, STILL)
    estimate.zero()
    after = _fz(estimate, model, STILL)
    noise_n = COARSENESS[model].noise_n
    assert abs(before[-1]) > noise_n
    assert (before - after).mean() == pytest.approx(before[-1], abs=0.5 * noise_n)


def test_the_seed_decides() -> None:
    """The same seed draws the same arm."""
    first, second = (
        _fz(ForceEstimate(RobotModel.CB3, seed=7), RobotModel.CB3, DOWN) for _ in range(2)
    )
    assert first.tolist() == second.tolist()
