"""Each limit on a force sample."""

import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocols.guard.breach_reaction import BreachError, Reaction
from protocols.guard.force_limits import NOISE_SAMPLES, Contact, ForceGuard, Liveness
from tacauchy_rig.core.run import ForceSample, Tare
from tests.protocols.conftest import breach

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
        wrench=(*force, ZERO.mean[3] + moment, 0.0, 0.0),
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
        ({"fz": -6.1}, "limits.soft_force", Reaction.RETRACT),
        ({"fx": 1.5, "fy": 1.5}, "limits.lateral_force", Reaction.RETRACT),
        ({"moment": math.inf}, "force_sensor.finite", Reaction.HOLD),
    ],
)
def test_a_load_beyond_a_limit_is_a_breach(guard, load, limit, reaction):
    """Whatever its sign and axis; test_faults_in_trial has the other limits."""
    with breach(limit, reaction):
        guard.check(sample(**load))


def test_a_breach_says_what_was_measured(guard):
    """The message holds limit and measurement with their units."""
    with breach("limits.soft_force", match=r"limits\.soft_force 6 N: measured 6\.100 N"):
        guard.check(sample(fz=6.1))


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
    with breach("limits.repeat_count", Reaction.HOLD):
        guard.check(sample(99))


def test_before_the_first_tare_only_the_sensor_is_judged(config):
    """Without a zero a bias of 12 N is no force, but a saturated channel is a fault."""
    guard = ForceGuard(config)
    assert guard.check(sample(1, fz=12.0)) == 0.0
    with breach("force_sensor.capacity"):
        guard.check(sample(2, fz=47.0))


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


ROW = 20


def noisy(number, *, seed=1, noise_n=0.008, rise_n=0.0):
    """Return samples of a live sensor, rising evenly."""
    draw = random.Random(seed)  # noqa: S311 - noise, not a secret
    return [
        (
            *(draw.gauss(0, noise_n), 0.0, k * rise_n + draw.gauss(0, noise_n)),
            *(draw.gauss(0, 1e-4), 0.0, 0.0),
        )
        for k in range(number)
    ]


def check_all(watch, wrenches):
    """Let a watch see samples."""
    for wrench in wrenches:
        watch.check(wrench)


def fed(wrenches):
    """Return a watch that has seen samples of an unloaded sensor."""
    watch = Liveness(row=ROW)
    check_all(watch, wrenches)
    watch.set_noise()
    return watch


def test_a_live_sensor_is_never_called_dead():
    """A minute at rest, a minute of a rising force, a table that comes to rest to a fifth."""
    lively = [*noisy(6000, seed=2), *noisy(6000, seed=3, rise_n=0.002)]
    for later in (lively, noisy(500, seed=2, noise_n=0.0016)):
        watch = fed(noisy(100))
        check_all(watch, later)
        (stuck,) = noisy(1, seed=9)
        with breach("witness.noise"):  # the same watch still finds one that begins to stick
            check_all(watch, [stuck] * 2 * NOISE_SAMPLES)


def test_a_last_digit_that_blinks_is_a_dead_sensor():
    """Two values in turn: found as a row, within a fifth of a second."""
    watch = fed(noisy(100))
    one, other = noisy(2, seed=5)
    with breach("witness.noise", match=r"sticks at .*repeat 2 values"):
        check_all(watch, [one, other] * ROW)


def test_noise_that_has_gone_is_a_dead_sensor():
    """A last digit that walks about never repeats a row."""
    watch = fed(noisy(100))
    with breach("witness.noise", match=r"sticks at .*noise"):
        check_all(watch, noisy(NOISE_SAMPLES + 1, seed=6, noise_n=1e-4))


def test_old_samples_that_come_again_are_named_with_their_age():
    """Three seconds late at 100 Hz, values and counters otherwise in order."""
    samples = noisy(400)
    watch = fed(samples)
    with breach("witness.old-data", match="300 samples ago"):
        check_all(watch, samples[100:])
