"""What all trials of a run together say of the force sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from tacauchy_rig.core.config.model import RobotModel
from tacauchy_rig.core.force_check import ForceCheck, judge_weight, parse_weight
from tacauchy_rig.core.force_history import judge_forces
from tacauchy_rig.core.run import Outcome, Tare, TrialRecord

TARGETS_N = (1.26, 1.95, 2.65, 3.34, 4.04, 4.73)
RIGHT = (1.0,) * 6


def force_at(depth_m: float) -> float:
    """Return what a made-up gel gives [N]: soft at first, then 5.5 N/mm."""
    return 5.5e3 * depth_m + 0.15 * float(np.expm1(-depth_m / 50e-6))


def pressed(
    gains: Sequence[float],
    *,
    zeros_n: Sequence[float] = (0.0,) * 6,
    arm_gain: float = 1.0,
    held_m: float = 5e-6,
) -> list[TrialRecord]:
    """Return trials whose sensor has a gain and a zero of its own in each of them."""
    noise = np.random.default_rng(1)
    records = []
    for index, (target_n, gain, zero_n) in enumerate(
        zip(TARGETS_N, gains, zeros_n, strict=False), start=1
    ):
        grid_m = np.arange(0.0, 1.5e-3, 20e-6)
        true_n = np.array([force_at(float(depth)) for depth in grid_m])
        read_n = zero_n + gain * true_n + noise.normal(0.0, 0.003, len(grid_m))
        count = int(np.argmax(read_n > target_n)) + 1
        held_n = (target_n - zero_n) / gain
        end_m = float(np.interp(held_n, true_n, grid_m))
        depths = (*grid_m[: count - 1], end_m)
        forces = (*read_n[: count - 1], target_n)
        records.append(
            TrialRecord(
                index=index,
                attempt=1,
                outcome=Outcome.PASSED,
                force_target_n=target_n,
                force_measured_n=target_n,
                depth_measured_m=end_m + held_m,
                arm_force_n=arm_gain * held_n + float(noise.normal(0.0, 0.03)),
                press_depth_m=tuple(map(float, depths)),
                press_force_n=tuple(map(float, forces)),
            )
        )
    return records


def weighed(scale: float) -> ForceCheck:
    """Return the check by a weight of which a sensor reads ``scale``."""
    weight = parse_weight("200g")

    def tare(fz_n: float) -> Tare:
        mean, deviation = (0.0, 0.0, fz_n, 0.0, 0.0, 0.0), (0.004,) * 6
        return Tare(start_ns=0, end_ns=1, mean=mean, deviation=deviation, sample_count=200)

    loaded = tare(-scale * weight.force_n)
    return judge_weight(
        weight, before=tare(0.0), loaded=loaded, after=tare(0.0), compression_sign=1, checked=""
    )


def falling(size: float) -> list[float]:
    """Return a gain that sinks by ``size`` from the first trial to the last."""
    return [1.0 - size * k / 5.0 for k in range(6)]


def test_a_right_sensor_is_believed_and_its_uncertainty_stated() -> None:
    """An e-Series arm knows its own gain to 2 %; small forces drown in its noise."""
    history = judge_forces(pressed(RIGHT), RobotModel.E_SERIES)
    assert not history.fault
    assert history.criterion().passed
    first, *_, last = history.trials
    assert 0.02 < last.gain_uncertainty < 0.035 < first.gain_uncertainty < 0.06
    assert history.uncertainty < 0.2


def test_a_gain_that_sinks_from_trial_to_trial_is_found_before_the_last() -> None:
    """By a quarter over six trials: each is within what the guard admits against the one before."""
    records = pressed(falling(0.25))
    found = [bool(judge_forces(records[:n], RobotModel.E_SERIES).fault) for n in range(1, 7)]
    assert found[:2] == [False, False]
    assert found[-2:] == [True, True]
    assert "times the true force" in judge_forces(records, RobotModel.E_SERIES).fault


def test_curves_alone_tell_a_gain_that_changed_but_not_one_that_was_wrong_all_along() -> None:
    """No arm that feels: what is the same in all trials shows in none of them."""
    sunk = [replace(record, arm_force_n=None) for record in pressed(falling(0.25))]
    assert "gain changed by -" in judge_forces(sunk, RobotModel.CB3).fault
    wrong = [replace(record, arm_force_n=None) for record in pressed((0.75,) * 6)]
    history = judge_forces(wrong, RobotModel.CB3)
    assert not history.fault
    assert history.uncertainty > 0.9


def test_a_weight_at_the_end_tells_of_all_trials() -> None:
    """The curves carry to the first what the weight says of the last."""
    records = pressed(RIGHT)
    coarse = judge_forces(records, RobotModel.CB3)
    known = judge_forces(records, RobotModel.CB3, weighed=weighed(1.01))
    assert coarse.uncertainty > 0.4
    assert known.uncertainty < 0.2
    assert not known.fault
    assert "weight of 200 g" in " ".join(known.sources)


def test_zero_and_gain_are_told_apart() -> None:
    """A zero of 0.05 N in one trial is no gain, and a gain is no zero."""
    shifted = judge_forces(pressed(RIGHT, zeros_n=(0, 0, 0, 0.05, 0, 0)), RobotModel.E_SERIES)
    others_n = [t.zero_n for t in shifted.trials if t.index != 4]
    assert shifted.trials[3].zero_n == pytest.approx(np.mean(others_n) + 0.05, abs=0.02)
    assert shifted.trials[3].gain == pytest.approx(1.0, abs=0.05)
    scaled = judge_forces(pressed((1.0, 1.0, 1.0, 0.9, 1.0, 1.0)), RobotModel.E_SERIES)
    assert scaled.trials[3].gain == pytest.approx(0.9, abs=0.03)
    assert scaled.trials[3].zero_n == pytest.approx(0.0, abs=0.03)


def test_a_reading_that_sinks_under_load_is_found_by_how_deep_the_press_goes() -> None:
    """At a constant reading a gel gives way by a tenth of its force, not by a fifth."""
    held = [replace(r, arm_force_n=None) for r in pressed(RIGHT, held_m=0.12e-3)]
    assert "loses force under load" in judge_forces(held, RobotModel.CB3).fault


def test_an_arm_that_lies_makes_the_sources_disagree() -> None:
    """Its estimate is off by a third from the fourth trial on, the curves are those of one gel."""
    records = pressed(RIGHT)
    records[3:] = [replace(r, arm_force_n=0.65 * (r.arm_force_n or 0.0)) for r in records[3:]]
    assert judge_forces(records, RobotModel.E_SERIES).fault
