"""The software zero: what counts of the interval in which nothing touches."""

from __future__ import annotations

import pytest

from protocols.guard.breach import BreachError
from protocols.steps.window import take_tare

SHORT = ('protocol.tare_duration="0.2 s"', 'robot.watchdog="2 Hz"')
HELD_UP_S = 0.25


def test_a_computer_that_is_held_up_does_not_lose_what_came_meanwhile(laboratory, monkeypatch):
    """It takes two samples, then nothing until the interval is over: the rest lies waiting."""
    lab = laboratory(*SHORT)
    clock, drain = lab.world.clock, lab.bench.arm.drain
    begun_ns = clock.now_ns()
    held_up: list[float] = []

    def slow_drain():
        if not held_up and clock.now_ns() - begun_ns > 2e7:
            held_up.append(HELD_UP_S)
            clock.sleep(HELD_UP_S)
        return drain()

    monkeypatch.setattr(lab.bench.arm, "drain", slow_drain)
    tare = take_tare(lab.cycle)
    assert held_up
    assert tare.sample_count >= 20


def test_a_slow_force_sensor_is_told_with_both_counts(laboratory):
    """A sensor that stopped sending is no zero."""
    lab = laboratory(*SHORT, 'limits.stale_force="500 ms"')
    lab.world.begin("force_sensor:stall")
    with pytest.raises(BreachError, match=r"samples in 0\.2 s of tare, 20 were expected"):
        take_tare(lab.cycle)
