"""What trials together, and a known weight, say of the force sensor: cells that lie are refused."""

import math
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tacauchy_rig.core.config.settings import RobotModel
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.force_sensor_gain import judge_forces
from tacauchy_rig.core.known_weight import ForceCheck, Weight, judge_weight, parse_weight
from tacauchy_rig.core.run import Outcome, Tare, TrialRecord, Vector3

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
    """A zero of 0.05 N in one trial is no gain."""
    shifted = judge_forces(pressed(RIGHT, zeros_n=(0, 0, 0, 0.05, 0, 0)), RobotModel.E_SERIES)
    assert shifted.trials[3].gain == pytest.approx(1.0, abs=0.05)
    scaled = judge_forces(pressed((1.0, 1.0, 1.0, 0.9, 1.0, 1.0)), RobotModel.E_SERIES)
    assert scaled.trials[3].gain == pytest.approx(0.9, abs=0.03)


def test_a_reading_that_sinks_under_load_is_found_by_how_deep_the_press_goes() -> None:
    """At a constant reading a gel gives way by a tenth of its force, not by a fifth."""
    held = [replace(r, arm_force_n=None) for r in pressed(RIGHT, held_m=0.12e-3)]
    assert "loses force under load" in judge_forces(held, RobotModel.CB3).fault


def test_an_arm_that_lies_makes_the_sources_disagree() -> None:
    """Its estimate is off by a third from the fourth trial on, the curves are those of one gel."""
    records = pressed(RIGHT)
    records[3:] = [replace(r, arm_force_n=0.65 * (r.arm_force_n or 0.0)) for r in records[3:]]
    assert judge_forces(records, RobotModel.E_SERIES).fault


WEIGHT = Weight(mass_kg=0.2, uncertainty_kg=0.002)
BIAS: Vector3 = (0.3, -0.2, 1.4)


def tare(change: Vector3 = (0.0, 0.0, 0.0), *, noise_n: float = 0.004) -> Tare:
    """Return what the cell reads with its bias and a change [N]."""
    fx, fy, fz = (bias + added for bias, added in zip(BIAS, change, strict=True))
    return Tare(
        start_ns=0,
        end_ns=1,
        mean=(fx, fy, fz, 0.0, 0.0, 0.0),
        deviation=(noise_n,) * 6,
        sample_count=200,
    )


def judged(
    change: Vector3, *, sign: int = 1, drift_n: float = 0.0, noise_n: float = 0.004
) -> ForceCheck:
    """Judge a raw change of the cell under the weight [N]."""
    return judge_weight(
        WEIGHT,
        before=tare(noise_n=noise_n),
        loaded=tare((change[0], change[1], change[2] + 0.5 * drift_n), noise_n=noise_n),
        after=tare((0.0, 0.0, drift_n), noise_n=noise_n),
        compression_sign=sign,
        checked="2026-01-01T00:00:00+00:00",
    )


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("scale", [0.96, 1.0, 1.04])
def test_a_cell_that_reads_the_weight_passes(scale: float, sign: int) -> None:
    """A few per cent are the cell's and the weight's own; bias and mounting do not count."""
    check = judged((0.03, -0.02, -sign * scale * WEIGHT.force_n), sign=sign)
    assert check.passed
    assert check.ratio == pytest.approx(scale)


@pytest.mark.parametrize(
    ("scale", "cause"),
    [
        (0.1, "a tenth"),
        (1.0 / 9.81, "kgf"),
        (10.0, "ten times"),
        (0.2248, "pounds-force"),
        (4.448, "pounds-force"),
        (0.5, "half of what the sheet says"),
        (2.0, "twice what the sheet says"),
        (0.85, "compare range, gain"),
        (1.15, "weigh the weight again"),
    ],
)
def test_a_wrong_scale_names_what_makes_it(scale: float, cause: str) -> None:
    """The ratio tells range, unit or gain."""
    check = judged((0.0, 0.0, -scale * WEIGHT.force_n))
    assert not check.passed
    assert cause in check.remedy
    assert f"{scale:.3g} of that" in check.finding


@pytest.mark.parametrize(
    ("change", "noise_n", "told"),
    [
        # What hangs pulls: a cell that calls it pressing has the other sign.
        ((0.0, 0.0, WEIGHT.force_n), 0.004, "^[^;]*force_sensor.compression_sign"),
        # Sign and scale are told together: one check is enough to mend both.
        ((0.0, 0.0, 0.1 * WEIGHT.force_n), 0.004, "compression_sign.*a tenth|a tenth.*compression"),
        # A weight that is felt sideways hangs on a cell that is turned or decoupled wrongly.
        ((-1.962, 0.0, 0.0), 0.004, r"AT\+DCPM"),
        ((0.0, 1.962, 0.0), 0.004, r"AT\+DCPM"),
        ((-1.5, 0.0, -1.2), 0.004, r"AT\+DCPM"),
        # The scale alone is right, and a quarter more is felt across the axis.
        ((0.5, 0.0, -WEIGHT.force_n), 0.004, "^0.500 N of it went sideways"),
        # A live cell has noise, whatever hangs on it.
        ((0.0, 0.0, 0.0), 0.0, "^the cell has no noise"),
        # Most often nobody hung it.
        ((0.0, 0.0, -0.01), 0.004, "did the weight hang"),
    ],
)
def test_a_wrong_cell_is_told_what_to_do(change: Vector3, noise_n: float, told: str) -> None:
    """By sign, axis, noise, or nothing felt at all."""
    assert re.search(told, judged(change, noise_n=noise_n).remedy, flags=re.DOTALL)


@pytest.mark.parametrize("doubt", [{"drift_n": 0.5}, {"noise_n": 0.15}])
def test_what_wanders_is_not_judged(doubt: dict[str, float]) -> None:
    """Drift or a swinging weight leave a right cell unjudged, and say so."""
    check = judged((0.0, 0.0, -WEIGHT.force_n), **doubt)
    assert check.remedy.startswith("drift and noise leave")


@pytest.mark.parametrize("drift_n", [-1.962, 1.962])
def test_a_weight_that_stayed_or_hung_too_early_is_told(drift_n: float) -> None:
    """Two zeros that differ by the weight are no drift."""
    check = judged((0.0, 0.0, -0.5 * WEIGHT.force_n), drift_n=drift_n)
    assert check.remedy.startswith(f"unloaded again the cell is {drift_n:+.3f} N off")


@given(scale=st.floats(0.9, 1.1), drift_n=st.floats(-0.15, 0.15))
def test_the_tolerance_is_what_it_says(scale: float, drift_n: float) -> None:
    """A cell passes just where it is within the stated tolerance, whatever its zero drifts."""
    check = judged((0.0, 0.0, -scale * WEIGHT.force_n), drift_n=drift_n)
    assert check.measured_n == pytest.approx(-scale * WEIGHT.force_n)
    assert check.passed == (abs(check.measured_n - check.expected_n) <= check.tolerance_n)
    assert check.tolerance_n <= 0.05 * WEIGHT.force_n + math.hypot(0.0197, 0.0081, 0.0751)


@pytest.mark.parametrize(
    ("text", "mass_kg", "uncertainty_kg"),
    [("200g", 0.2, 0.002), ("0.5 kg +- 1 g", 0.5, 0.001), ("100 g ± 0.5 g", 0.1, 0.0005)],
)
def test_a_weight_is_read(text: str, mass_kg: float, uncertainty_kg: float) -> None:
    """With its own uncertainty, or one per cent."""
    weight = parse_weight(text)
    assert (weight.mass_kg, weight.uncertainty_kg) == pytest.approx((mass_kg, uncertainty_kg))


@pytest.mark.parametrize("text", ["200", "2 N", "1 g", "20 kg", "-200g", "", "200g+-much"])
def test_what_is_no_weight_is_refused(text: str) -> None:
    """The option is named."""
    with pytest.raises(ConfigError, match=r"--check-weight"):
        parse_weight(text)
