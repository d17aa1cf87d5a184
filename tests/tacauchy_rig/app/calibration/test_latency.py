"""Delays of made-up signals against a depth that sways."""

import math

import numpy as np
import pytest

from protocols.steps.force_servo_hold_sway import FREQUENCIES_HZ
from tacauchy_rig.app.calibration.latency import (
    Delay,
    even_stamps,
    find_delay,
    find_latency,
    trigger_missed,
)
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.errors import RecordError
from tests.recorded_run import empty_run

RELAXATION_S = (0.3, 3.0)
ARM_S = np.arange(0.0, 12.0, 0.008)


def _depth(time_s):
    return 3e-4 - sum(1e-5 / f * (1.0 - np.cos(2.0 * np.pi * f * time_s)) for f in FREQUENCIES_HZ)


def _remembered(time_s, relaxation_s, *, delay_s):
    """Return what a branch of a Maxwell solid pulls with, in steady state."""
    value = np.zeros_like(time_s)
    for f in FREQUENCIES_HZ:
        rate = 2.0 * np.pi * f
        lag = rate * relaxation_s
        size = 1e-5 / f * lag / math.hypot(1.0, lag)
        value += size * np.cos(rate * (time_s - delay_s) + math.atan2(1.0, lag))
    return value


@pytest.mark.parametrize("delay_s", [-0.01, 0.004, 0.025, 0.11])
def test_a_delay_is_found_through_noise_and_a_bent_spring(delay_s):
    """The depth's shift is found within its uncertainty and 2 ms, whatever the spring's law."""
    time_s = np.arange(0.0, 12.0, 0.01)
    force = 1e4 * _depth(time_s - delay_s) + 1e7 * _depth(time_s - delay_s) ** 2
    force += np.random.default_rng(3).normal(0.0, 0.008, len(force)) + 5e-4 * time_s
    found = find_delay((ARM_S, _depth(ARM_S)), (time_s, force), name="force")
    assert abs(found.delay_s - delay_s) < min(2e-3, 4.0 * found.uncertainty_s)
    assert found.uncertainty_s < 1e-3


def test_frames_of_another_moment_are_left_out_and_counted():
    """A camera that stands still for six frames at a time shows what has been."""
    time_s = np.arange(0.0, 12.0, 0.04)
    noise = np.random.default_rng(5).normal(0.0, 1.0, len(time_s))
    seen = 1e6 * _depth(time_s - 0.022) + noise
    for start in (100, 280):
        seen[start : start + 6] = seen[start - 1]
    found = find_delay((ARM_S, _depth(ARM_S)), (time_s, seen), name="image")
    assert 2 <= found.stale_count <= 14
    assert abs(found.delay_s - 0.022) < 2e-3
    even = find_delay((ARM_S, _depth(ARM_S)), (time_s, 1e6 * _depth(time_s) + noise), name="image")
    assert even.stale_count <= 2


def test_relaxation_is_no_delay():
    """A gel that creeps leads its depth: branches take that up, without them it is off."""
    time_s = np.arange(0.0, 12.0, 0.01)
    force = 1e4 * (
        _depth(time_s - 0.02) + 0.15 * _remembered(time_s, RELAXATION_S[0], delay_s=0.02)
    )
    signal, depth = (time_s, force), (ARM_S, _depth(ARM_S))
    told = find_delay(depth, signal, name="force", relaxation_s=RELAXATION_S)
    plain = find_delay(depth, signal, name="force")
    assert abs(told.delay_s - 0.02) < 1e-3 < abs(plain.delay_s - 0.02)


def test_a_stated_doubt_of_the_arm_counts():
    """The uncertainty is never below that of the arm's own times."""
    time_s = np.arange(0.0, 12.0, 0.01)
    found = find_delay(
        (ARM_S, _depth(ARM_S)),
        (time_s, _depth(time_s)),
        name="force",
        depth_time_uncertainty_s=2e-3,
    )
    assert found.uncertainty_s >= 2e-3


@pytest.mark.parametrize(("end_s", "told"), [(12.0, "explains"), (2.0, "too few")])
def test_noise_alone_and_too_short_a_motion_are_refused(end_s, told):
    """With what to do."""
    time_s = np.arange(0.0, end_s, 0.04)
    noise = np.random.default_rng(1).normal(0.0, 1.0, len(time_s))
    with pytest.raises(RecordError, match=told) as caught:
        find_delay((ARM_S, _depth(ARM_S)), (time_s, noise), name="image")
    assert caught.value.remedy


def test_late_reads_do_not_move_even_stamps():
    """One stamp in five is up to 30 ms late: the others say when a sample is stamped."""
    counter = np.arange(1000.0)
    late_s = np.where(counter % 5 == 0, np.random.default_rng(2).uniform(0.0, 0.03, 1000), 0.0)
    stamps = (1e9 * (7.0 + 0.01 * counter + late_s)).astype(np.int64)
    assert np.abs(even_stamps(stamps, counter) - (7.0 + 0.01 * counter)).max() < 1e-3


def _delay(delay_s):
    return Delay(delay_s=delay_s, uncertainty_s=5e-4, explained=0.99, sample_count=300)


def _config(mode):
    return load_config(overrides=[f'run.sync_mode="{mode}"']).config


@pytest.mark.parametrize(
    ("mode", "image_s", "told"),
    [
        ("external_trigger", 0.009, ""),  # within a quarter of a frame
        ("external_trigger", 0.034, "+30.0 ms"),
        ("host_clock", 0.034, ""),  # promises nothing
    ],
)
def test_a_declared_trigger_is_believed_where_it_keeps_its_word(mode, image_s, told):
    """Image and force of one moment are stamped together, or the delay between them is named."""
    missed = trigger_missed(_config(mode), _delay(0.004), _delay(image_s))
    assert (told in missed) if told else not missed


def test_a_run_that_did_not_sway_is_refused(tmp_path):
    """The remedy names the command that makes one."""
    store = empty_run(tmp_path)
    store.paths.journal.write_bytes(b"")
    with pytest.raises(RecordError, match="swayed") as caught:
        find_latency(store)
    assert "calibrate latency" in caught.value.remedy
