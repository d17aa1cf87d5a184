"""Stale and lossy streams, and a computer that was held up."""

import math

import pytest

from drivers.interfaces import StreamHealth
from protocols.guard.breach_reaction import BreachError, Reaction
from protocols.guard.stale_streams import StreamGuard
from tacauchy_rig.core.run import ForceSample
from tests.protocols.conftest import breach


def arrived(counter, *, delay_s=0.0, rate_hz=100.0):
    """Return a sample that came ``delay_s`` late."""
    wrench = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    stamp_ns = round((counter / rate_hz + delay_s) * 1e9)
    return ForceSample(stamp_ns=stamp_ns, counter=counter, wrench=wrench)


def health(*, age_s=0.0, received=1000, lost=0, repeats=0):
    """Return a stream's health."""
    return StreamHealth(
        received_count=received,
        lost_count=lost,
        corrupt_count=0,
        repeat_count=repeats,
        age_s=age_s,
        rate_hz=100.0,
    )


@pytest.fixture
def guard(config):
    """Return a guard whose loop has been running well for a second."""
    guard = StreamGuard(config)
    for _ in range(200):
        guard.note_turn(0.005)
    return guard


def test_old_force_means_hold(guard):
    """Without force the arm may not move: stop and hold."""
    guard.check_force(health(age_s=0.049), now_ns=0)
    for age_s in (0.051, -0.051):  # or stamped by another clock
        with breach("limits.stale_force", Reaction.HOLD):
            guard.check_force(health(age_s=age_s), now_ns=0)


def test_old_images_mean_retract(guard):
    """Robot and force sensor are alive, so the gel is left."""
    guard.check_image(health(age_s=0.19))
    for age_s in (0.21, math.inf):  # or never sent
        with breach("limits.stale_image", Reaction.RETRACT):
            guard.check_image(health(age_s=age_s))


def test_a_computer_that_was_held_up_does_not_blame_the_sensor(guard):
    """After a pause of 80 ms the age counts again once the loop has run for the limit."""
    guard.note_turn(0.08)
    guard.check_force(health(age_s=0.09), now_ns=0)
    for _ in range(11):
        guard.note_turn(0.005)
    with pytest.raises(BreachError, match="held up for 80 ms, 55 ms ago"):
        guard.check_force(health(age_s=0.14), now_ns=0)


def test_patience_ends(guard):
    """Even on a computer that pauses all the time, 4 times the limit is the end."""
    guard.note_turn(0.25)
    with pytest.raises(BreachError):
        guard.check_force(health(age_s=0.21), now_ns=0)


def test_too_many_lost_frames_are_a_breach(guard):
    """6 % lost within two seconds is too much; 4 % is not."""
    guard.check_force(health(received=1000, lost=0), now_ns=0)
    guard.check_force(health(received=1096, lost=4), now_ns=1_000_000_000)
    with breach("limits.corrupt_ratio"):
        guard.check_force(health(received=1150, lost=12), now_ns=1_600_000_000)


def test_losses_of_long_ago_are_forgotten(guard):
    """Only the last two seconds count: ten lost are too many of the 110 in them, not of all."""
    guard.check_force(health(received=0, lost=100), now_ns=0)
    guard.check_force(health(received=100, lost=100), now_ns=1_000_000_000)
    guard.check_force(health(received=400, lost=100), now_ns=4_000_000_000)
    with pytest.raises(BreachError, match="10 of 110 force frames"):
        guard.check_force(health(received=500, lost=110), now_ns=5_000_000_000)


def test_force_that_arrives_late_is_stale_although_it_flows(guard):
    """A stream delayed by 80 ms has fresh stamps; its numbers give it away."""
    for counter in range(100):
        guard.note_force(arrived(counter))
    guard.check_force(health(), now_ns=0)
    guard.note_force(arrived(110, delay_s=0.08))
    with pytest.raises(BreachError, match=r"arrive 7[0-9] ms late"):
        guard.check_force(health(), now_ns=0)


def test_a_box_that_is_a_little_slow_is_not_late(guard):
    """A rate of 99.5 Hz instead of 100 Hz is a property of the box's clock, for ten minutes."""
    for counter in range(0, 60_000, 10):
        guard.note_force(arrived(counter, rate_hz=99.5))
        guard.check_force(health(), now_ns=0)
    assert guard.force_lag_s < 1e-3
    # One whose clock is as slow and that then comes 80 ms late is told from it.
    guard.note_force(arrived(60_000, rate_hz=99.5, delay_s=0.08))
    with pytest.raises(BreachError, match=r"arrive 7[0-9] ms late|arrive 80 ms late"):
        guard.check_force(health(), now_ns=0)


def test_the_same_image_again_and_again_is_a_dead_camera(guard, config):
    """Frames that flow and never change show nothing."""
    guard.check_image(health(repeats=config.limits.repeat_count - 1))
    with breach("limits.repeat_count", Reaction.RETRACT):
        guard.check_image(health(repeats=config.limits.repeat_count))
