"""The software zero, and a run that begins where a fault left the arm: in the gel."""

import pytest

from protocols.guard.breach_reaction import BreachError
from protocols.steps.preflight import leave_gel, run_preflight
from protocols.steps.tare_and_force_window import take_tare

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


BIAS_N = 1.4  # of the mock world's Fz


def put_tip(laboratory, height_m):
    """Place the tip above the gel's expected surface and let the force follow."""
    world = laboratory.world
    z = laboratory.config.sensor.surface[2] + height_m
    world.pose = world.pose.shifted(z=z - world.pose.position[2])
    world.clock.sleep(0.05)
    world.catch_up()


def test_preflight_takes_the_indenter_off_the_gel_before_it_weighs_nothing(laboratory):
    """Pressed in by 0.6 mm: up to the approach height, and the zero is that of the free sensor."""
    place = laboratory()
    put_tip(place, -0.0006)
    assert place.world.force_n > 1.5
    tare = run_preflight(place.cycle)
    height_m = place.world.pose.position[2] - place.config.sensor.surface[2]
    assert height_m == pytest.approx(place.config.protocol.approach_height, abs=5e-5)
    assert tare.mean[2] == pytest.approx(BIAS_N, abs=0.05)
    assert place.bench.arm.fastest_m_s <= 0.00201


def test_nothing_moves_where_the_tip_is_clear(laboratory):
    """At home there is nothing to leave."""
    place = laboratory()
    before = place.world.pose
    leave_gel(place.cycle)
    assert place.world.pose == before


def test_a_tip_that_sticks_stops_the_way_up(laboratory):
    """A sideways force on the way up is a breach, as always."""
    place = laboratory()
    put_tip(place, -0.0006)
    place.world.when(
        lambda: place.world.velocity[2] > 0.0,
        lambda: setattr(place.world, "disturbance", (3.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
    )
    with pytest.raises(BreachError, match=r"limits\.lateral_force"):
        run_preflight(place.cycle)
