"""Devices that lie: each lie is what its name says, ends with its fault, and draws no attention."""

from __future__ import annotations

import random

import numpy as np
import pytest

from drivers.emulators.faults import parse_fault
from drivers.emulators.silent_faults import SilentArmFaults, SilentImageFaults, SilentWrenchFaults
from tacauchy_rig.core.run import Vector6

PERIOD_NS = 10_000_000
NOISE_N = 0.008
FULL_SCALE_N = 50.0


def _felt(index: int, noise: random.Random) -> Vector6:
    """Return a force that rises by 0.3 N/s, with noise."""
    a, b, c, d, e, f = (noise.gauss(0.0, NOISE_N) for _ in range(6))
    return (0.5 + a, b, 2.0 + 3e-3 * index + c, d, e, 0.01 + f)


def _played(text: str, *, before: int = 400, during: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Return what was felt and what was said, [sample, 6], the fault on for the later ones."""
    noise, sensor = random.Random(1), SilentWrenchFaults(seed=1, full_scale_n=FULL_SCALE_N)  # noqa: S311
    felt = [_felt(index, noise) for index in range(before + during)]
    said = [
        sensor.reading(
            each, [parse_fault(text)] if index >= before else [], stamp_ns=index * PERIOD_NS
        )
        for index, each in enumerate(felt)
    ]
    assert said[:before] == felt[:before]
    return np.array(felt[before:]), np.array(said[before:])


@pytest.mark.parametrize(("text", "factor"), [("scale=0.1", 0.1), ("scale", 0.5), ("sign", -1.0)])
def test_scale_and_sign_turn_every_channel(text: str, factor: float) -> None:
    """All six channels are multiplied, noise and all."""
    felt, said = _played(f"force_sensor:{text}")
    np.testing.assert_allclose(said, factor * felt)


def test_swapped_axes() -> None:
    """F_z and F_x change places, M_z and M_x too."""
    felt, said = _played("force_sensor:swap-axes")
    np.testing.assert_array_equal(said, felt[:, [2, 1, 0, 5, 4, 3]])


def test_a_stuck_sensor_alternates_in_its_last_digit_alone() -> None:
    """Two values, a ten-thousandth apart: no two neighbours are equal."""
    _, said = _played("force_sensor:stick")
    assert len(np.unique(said[:, 2])) == 2
    np.testing.assert_allclose(np.abs(np.diff(said[:, 2])), 1e-4)


def test_a_sensor_that_sticks_noisily_keeps_its_mean_and_its_noise() -> None:
    """The mean stays where it was while the force rises by 1.2 N; the noise is the old one."""
    felt, said = _played("force_sensor:stick-noisily")
    assert felt[-1, 2] - felt[0, 2] > 1.0
    assert np.mean(said[:, 2]) == pytest.approx(felt[0, 2], abs=0.03)
    assert np.std(said[:, 2]) == pytest.approx(NOISE_N, rel=0.25)
    assert np.std(said[:, 1]) == pytest.approx(NOISE_N, rel=0.25)


def test_one_that_sticks_noisily_from_its_first_sample_has_noise_too() -> None:
    """It sticks after a second, when it knows its noise: without any it would be found at once."""
    felt, said = _played("force_sensor:stick-noisily", before=0, during=400)
    np.testing.assert_array_equal(said[:100], felt[:100])
    assert len(np.unique(said[:, 2])) == 400
    assert np.mean(said[100:, 2]) == pytest.approx(felt[100, 2], abs=0.03)
    assert np.std(said[100:, 2]) == pytest.approx(NOISE_N, rel=0.25)


def test_old_data_are_those_of_before() -> None:
    """What is said is what was felt two seconds ago."""
    felt, said = _played("force_sensor:old-data=2s")
    np.testing.assert_array_equal(said[200:], felt[:-200])


def test_old_data_begin_with_the_oldest() -> None:
    """Where nothing is old enough, the oldest sample stands in."""
    _, said = _played("force_sensor:old-data=3s", before=1, during=250)
    assert len(np.unique(said[:, 2])) == 1


def test_freeze_and_saturation() -> None:
    """A frozen sensor repeats itself; a saturated one reads its full scale in F_z alone."""
    felt, said = _played("force_sensor:freeze")
    assert np.all(said == felt[0])
    felt, said = _played("force_sensor:saturate")
    assert np.all(said[:, 2] == FULL_SCALE_N)
    np.testing.assert_array_equal(said[:, 0], felt[:, 0])


def test_a_second_time_it_sticks_where_it_is_then() -> None:
    """After a fault the sensor is honest, and the next one begins anew."""
    noise, sensor = random.Random(1), SilentWrenchFaults(seed=1, full_scale_n=FULL_SCALE_N)  # noqa: S311
    stuck = [parse_fault("force_sensor:freeze")]
    felt = [_felt(index, noise) for index in range(4)]
    said = [
        sensor.reading(each, faults, stamp_ns=index * PERIOD_NS)
        for index, (each, faults) in enumerate(zip(felt, (stuck, [], stuck, stuck), strict=True))
    ]
    assert said == [felt[0], felt[1], felt[2], felt[2]]


def test_images_freeze_and_repeat() -> None:
    """A frozen camera repeats one frame; a looping one the first few of its fault."""
    camera = SilentImageFaults()
    frames = [bytes([index]) for index in range(9)]
    freeze, loop = [parse_fault("camera:freeze-image")], [parse_fault("camera:repeat-image=3")]
    faults = [[], freeze, freeze, [], *[loop] * 5]
    said = [camera.frame(jpeg, on) for jpeg, on in zip(frames, faults, strict=True)]
    assert b"".join(said) == bytes([0, 1, 1, 3, 4, 5, 6, 4, 5])


def test_an_arm_drifts_and_its_clock_jumps() -> None:
    """While it moves the pose drifts as asked; both are right again when the fault ends."""
    arm = SilentArmFaults()
    still: Vector6 = (0.0,) * 6
    down: Vector6 = (0.0, 0.0, -1e-3, 0.0, 0.0, 0.0)
    on = [parse_fault("robot:wrong-pose=-0.2mm/s"), parse_fault("robot:clock-jump=-3s")]
    for _ in range(100):
        arm.advance(on, down, duration_s=0.008)
        arm.advance(on, still, duration_s=0.008)
    assert arm.height_m == pytest.approx(-0.16e-3)
    assert arm.clock_s == -3.0
    arm.advance([], still, duration_s=0.008)
    assert (arm.height_m, arm.clock_s) == (0.0, 0.0)
