"""How the emulated arm moves, and what it makes of the force on its tool."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.emulators.arm.coarse_force_estimate import COARSENESS, ForceEstimate
from drivers.emulators.arm.safety_and_registers import STILL, ToolMotion
from tacauchy_rig.core.config.settings import RobotModel
from tacauchy_rig.core.rotations import composed
from tacauchy_rig.core.run import Pose, Vector3, Vector6

_HOME = Pose(position=(0.3, -0.2, 0.25), rotation_vector=(math.pi, 0.0, 0.0))
_STEP_S = 0.002
_offset = st.floats(-0.05, 0.05)
_small_angle = st.floats(-0.05, 0.05)


def _run(motion: ToolMotion, *, limit_s: float = 20.0) -> list[tuple[float, float]]:
    """Step to rest; return (speed, travelled) of every step."""
    history: list[tuple[float, float]] = []
    for _ in range(int(limit_s / _STEP_S)):
        if motion.is_still:
            return history
        before = motion.pose
        motion.step(_STEP_S)
        speed = math.hypot(*motion.velocity[:3])
        history.append((speed, math.dist(before[:3], motion.pose[:3])))
    pytest.fail("the arm never came to rest")


@settings(max_examples=40, deadline=None)
@given(
    offset=st.tuples(_offset, _offset, _offset),
    turn=st.tuples(_small_angle, _small_angle, _small_angle),
    speed=st.floats(0.02, 0.2),
    acceleration=st.floats(0.1, 1.0),
)
def test_line_reaches_its_target_within_limits(
    offset: Vector3, turn: Vector3, speed: float, acceleration: float
) -> None:
    """A straight move ends exactly at its target and passes neither limit on the way."""
    motion = ToolMotion(_HOME)
    x, y, z = (a + b for a, b in zip(_HOME.position, offset, strict=True))
    target = (x, y, z, *composed(turn, _HOME.rotation_vector))
    motion.move_to(target, speed=speed, acceleration=acceleration)
    history = _run(motion)
    assert motion.pose == target
    assert motion.velocity == (0.0,) * 6
    speeds = [0.0, *(speed for speed, _ in history)]
    assert max(speeds) <= speed * (1.0 + 1e-9)
    rises = [b - a for a, b in itertools.pairwise(speeds)]
    assert max(rises, default=0.0) <= acceleration * _STEP_S * (1.0 + 1e-9)
    assert sum(path for _, path in history) == pytest.approx(math.hypot(*offset), abs=1e-6)


def test_velocity_is_approached_and_braked() -> None:
    """Braking from 5 mm/s at 0.1 m/s^2 takes v^2/2a, 0.125 mm, no more and no less."""
    motion = ToolMotion(_HOME)
    motion.set_velocity((0.0, 0.0, -0.005, 0.0, 0.0, 0.0), acceleration=0.1)
    for _ in range(200):
        motion.step(_STEP_S)
    assert motion.velocity[2] == pytest.approx(-0.005)
    before = motion.pose[2]
    motion.brake(0.1)
    _run(motion)
    assert before - motion.pose[2] == pytest.approx(0.005**2 / 0.2, rel=1e-6)


def test_a_stalled_arm_stands_but_can_be_stopped() -> None:
    """Stalled, nothing moves; a stop still ends the motion for the program."""
    motion = ToolMotion(_HOME)
    motion.stalled = True
    motion.move_to((0.3, -0.2, 0.2, math.pi, 0.0, 0.0), speed=0.01, acceleration=0.1)
    for _ in range(100):
        motion.step(_STEP_S)
    assert not motion.is_still
    assert motion.pose == _HOME.as_vector()
    motion.brake(1.0)
    motion.step(_STEP_S)
    assert motion.is_still


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
