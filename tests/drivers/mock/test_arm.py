"""The mock arm behaves as the interface promises."""

from __future__ import annotations

import pytest

from tacauchy_rig.core.errors import DeviceError


def pass_time(bench, duration_s, *, kick=True):
    """Let time pass in small steps, feeding the watchdog."""
    for _ in range(round(duration_s / 0.01)):
        if kick:
            bench.arm.kick_watchdog()
        bench.world.clock.sleep(0.01)
    bench.world.catch_up()


def test_it_lies_about_its_place_and_time(bench):
    """A wrong pose drifts off the true one, a clock jumps; both are right again afterwards."""
    start_s = bench.world.elapsed_s
    bench.world.plan(
        [f"robot:wrong-pose=1mm/s@{start_s}s+1s", f"robot:clock-jump=-5s@{start_s}s+1s"]
    )
    bench.arm.set_velocity((1e-3, 0.0, 0.0, 0.0, 0.0, 0.0), acceleration=0.5)
    pass_time(bench, 0.9)
    state = bench.arm.state()
    off_m = state.pose.position[2] - bench.world.pose.position[2]
    assert off_m == pytest.approx(0.9e-3, abs=5e-5)
    assert state.controller_time_s - bench.world.elapsed_s == pytest.approx(-5.0, abs=0.01)
    pass_time(bench, 0.3)
    assert bench.arm.state().pose == bench.world.pose
    assert bench.arm.state().controller_time_s > 0.0


def test_a_stop_ends_with_its_fault_or_at_the_pendant(bench):
    """A protective stop locks the arm until its time is over, or somebody unlocks it."""
    start_s = bench.world.elapsed_s
    plan = [
        f"robot:protective-stop@{start_s}s+500ms",
        f"robot:protective-stop@{start_s + 1}s",
        f"robot:unlock@{start_s + 2}s",
    ]
    bench.world.plan(plan)
    for locked in (True, False, True, True, False):
        pass_time(bench, 0.45)
        if locked:
            with pytest.raises(DeviceError, match="protective stop"):
                bench.arm.state()
        else:
            bench.arm.state()


def test_a_frozen_controller_is_an_error(bench):
    """States that stop coming raise after 50 ms."""
    bench.world.begin("robot:freeze")
    pass_time(bench, 0.04)
    bench.arm.state()
    pass_time(bench, 0.03)
    with pytest.raises(DeviceError, match="has not moved"):
        bench.arm.state()
