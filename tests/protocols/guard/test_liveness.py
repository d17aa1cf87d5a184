"""A sensor that sends, but nothing new."""

from __future__ import annotations

import random

import pytest

from protocols.guard.breach import BreachError
from protocols.guard.liveness import NOISE_SAMPLES, Liveness
from tacauchy_rig.core.run import Wrench

ROW = 20


def noisy(number, *, seed=1, noise_n=0.008, rise_n=0.0):
    """Return samples of a live sensor, rising evenly."""
    draw = random.Random(seed)  # noqa: S311 - noise, not a secret
    return [
        Wrench(
            force=(draw.gauss(0, noise_n), 0.0, k * rise_n + draw.gauss(0, noise_n)),
            torque=(draw.gauss(0, 1e-4), 0.0, 0.0),
        )
        for k in range(number)
    ]


def check_all(watch, wrenches):
    """Let a watch see samples."""
    for wrench in wrenches:
        watch.check(wrench)


def assert_found_dead(watch):
    """The same watch still finds a sensor that begins to stick."""
    (stuck,) = noisy(1, seed=9)
    with pytest.raises(BreachError) as caught:
        check_all(watch, [stuck] * 2 * NOISE_SAMPLES)
    assert caught.value.limit == "witness.noise"


def fed(wrenches):
    """Return a watch that has seen samples of an unloaded sensor."""
    watch = Liveness(row=ROW)
    check_all(watch, wrenches)
    watch.set_noise()
    return watch


def test_a_live_sensor_is_never_called_dead():
    """A minute of noise at rest, then a minute of a rising force."""
    watch = fed(noisy(100))
    check_all(watch, [*noisy(6000, seed=2), *noisy(6000, seed=3, rise_n=0.002)])
    assert_found_dead(watch)


def test_a_table_that_comes_to_rest_is_not_called_dead():
    """Noise that falls to a fifth is no dead sensor."""
    watch = fed(noisy(100))
    check_all(watch, noisy(500, seed=2, noise_n=0.0016))
    assert_found_dead(watch)


def test_a_last_digit_that_blinks_is_a_dead_sensor():
    """Two values in turn: found as a row, within a fifth of a second."""
    watch = fed(noisy(100))
    one, other = noisy(2, seed=5)
    with pytest.raises(BreachError, match=r"sticks at .*repeat 2 values") as caught:
        check_all(watch, [one, other] * ROW)
    assert caught.value.limit == "witness.noise"


def test_noise_that_has_gone_is_a_dead_sensor():
    """A last digit that walks about never repeats a row."""
    watch = fed(noisy(100))
    with pytest.raises(BreachError, match=r"sticks at .*noise") as caught:
        check_all(watch, noisy(NOISE_SAMPLES + 1, seed=6, noise_n=1e-4))
    assert caught.value.limit == "witness.noise"


def test_old_samples_that_come_again_are_named_with_their_age():
    """Three seconds late at 100 Hz, values and counters otherwise in order."""
    samples = noisy(400)
    watch = fed(samples)
    with pytest.raises(BreachError, match="300 samples ago") as caught:
        check_all(watch, samples[100:])
    assert caught.value.limit == "witness.old-data"
