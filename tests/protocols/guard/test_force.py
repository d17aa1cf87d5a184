"""Each limit on a force sample."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocols.guard.breach import BreachError, Reaction
from protocols.guard.force import Contact, ForceGuard
from tacauchy_rig.core.run import ForceSample, Tare, Wrench

ZERO = Tare(
    start_ns=0,
    end_ns=1,
    mean=(0.5, -0.5, 2.0, 0.01, 0.0, 0.0),
    deviation=(0.0,) * 6,
    sample_count=100,
)


def sample(counter=1, *, fx=0.0, fy=0.0, fz=0.0, moment=0.0):
    """Return a sample that differs from the zero by the given load."""
    force = (ZERO.mean[0] + fx, ZERO.mean[1] + fy, ZERO.mean[2] + fz)
    return ForceSample(
        stamp_ns=counter * 10_000_000,
        counter=counter,
        wrench=Wrench(force=force, torque=(ZERO.mean[3] + moment, 0.0, 0.0)),
    )


@pytest.fixture
def guard(config):
    """Return a tared guard that expects contact."""
    guard = ForceGuard(config)
    guard.set_zero(ZERO)
    guard.contact = Contact.EXPECTED
    return guard


@pytest.mark.parametrize(
    ("load", "limit", "reaction"),
    [
        ({"fz": 6.1}, "limits.soft_force", Reaction.RETRACT),
        ({"fz": -6.1}, "limits.soft_force", Reaction.RETRACT),
        ({"fz": 10.1}, "limits.hard_force", Reaction.PROTECTIVE_STOP),
        ({"fx": 1.5, "fy": 1.5}, "limits.lateral_force", Reaction.RETRACT),
        ({"moment": 0.11}, "limits.moment", Reaction.RETRACT),
        ({"fx": 48.0}, "force_sensor.capacity", Reaction.HOLD),
        ({"fz": math.nan}, "force_sensor.finite", Reaction.HOLD),
        ({"moment": math.inf}, "force_sensor.finite", Reaction.HOLD),
    ],
)
def test_a_load_beyond_a_limit_is_a_breach(guard, load, limit, reaction):
    """Each limit names itself and says what may follow the stop."""
    with pytest.raises(BreachError) as caught:
        guard.check(sample(**load))
    assert caught.value.limit == limit
    assert caught.value.reaction is reaction
    assert caught.value.remedy


def test_a_breach_says_what_was_measured(guard):
    """The message holds limit and measurement with their units."""
    with pytest.raises(BreachError, match=r"soft_force 6 N: measured 6\.100 N"):
        guard.check(sample(fz=6.1))


def test_touching_where_nothing_should_be_is_a_breach(guard):
    """Half a newton is fine while pressing and a breach on the way there."""
    assert guard.check(sample(1, fz=0.5)) == pytest.approx(0.5)
    guard.contact = Contact.NONE
    with pytest.raises(BreachError) as caught:
        guard.check(sample(2, fz=0.5))
    assert caught.value.limit == "limits.early_contact"


def test_a_blow_is_a_breach_before_the_soft_limit(guard):
    """A force that rises by 1 N a sample passes the rate limit below 6 N."""
    for number in range(1, 5):
        guard.check(sample(number, fz=number * 1.0))
    with pytest.raises(BreachError) as caught:
        guard.check(sample(5, fz=5.0))
    assert caught.value.limit == "limits.force_rate"


def test_lost_frames_do_not_look_like_a_blow(guard):
    """The slope is taken over the box's counter, so a gap in it does not steepen the rise."""
    numbers = range(1, 22, 4)
    found = [guard.check(sample(number, fz=0.25 * number)) for number in numbers]
    assert found == pytest.approx([0.25 * number for number in numbers])
    # The same samples without a gap between them are one.
    guard.set_zero(ZERO)
    for place, number in enumerate(numbers[:4]):
        guard.check(sample(place, fz=0.25 * number))
    with pytest.raises(BreachError, match=r"limits\.force_rate .* measured 100\.0 N/s"):
        guard.check(sample(4, fz=0.25 * numbers[4]))


def test_letting_go_of_the_gel_is_no_blow(guard):
    """A force that falls at once is not a breach."""
    for number in range(1, 6):
        guard.check(sample(number, fz=4.0 + 0.001 * number))
    assert guard.check(sample(6, fz=0.0)) == pytest.approx(0.0, abs=1e-12)
    # Coming back as fast is one.
    for number in range(7, 10):
        guard.check(sample(number, fz=4.0 + 0.001 * number))
    with pytest.raises(BreachError, match=r"limits\.force_rate .* measured 80\.\d N/s"):
        guard.check(sample(10, fz=4.01))


def test_identical_samples_are_a_dead_sensor(guard, config):
    """As many equal samples as ``repeat_count`` make a breach, and no fewer."""
    for number in range(1, config.limits.repeat_count):
        guard.check(sample(number))
    with pytest.raises(BreachError) as caught:
        guard.check(sample(99))
    assert caught.value.limit == "limits.repeat_count"
    assert caught.value.reaction is Reaction.HOLD


def test_before_the_first_tare_only_the_sensor_is_judged(config):
    """Without a zero a bias of 12 N is no force, but a saturated channel is a fault."""
    guard = ForceGuard(config)
    assert guard.check(sample(1, fz=12.0)) == 0.0
    with pytest.raises(BreachError) as caught:
        guard.check(sample(2, fz=47.0))
    assert caught.value.limit == "force_sensor.capacity"


@given(fz=st.floats(-9.9, 9.9), contact=st.sampled_from(Contact))
def test_no_force_beyond_the_soft_limit_passes_unseen(config, fz, contact):
    """Whatever is expected except leaving, a force beyond the soft limit is a breach."""
    guard = ForceGuard(config)
    guard.set_zero(ZERO)
    guard.contact = contact
    try:
        pressing = guard.check(sample(1, fz=fz))
    except BreachError:
        return
    assert pressing == pytest.approx(fz)
    if contact is not Contact.LEAVING:
        assert abs(pressing) <= config.limits.soft_force
    if contact is Contact.NONE:
        assert abs(pressing) <= config.limits.early_contact
