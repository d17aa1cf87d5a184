"""Reading a cell without, with, and without a weight: mocks in virtual time, the real driver."""

import math
from pathlib import Path

import pytest

from drivers.emulators.process import hang_weight
from drivers.force_sensor import weighing
from drivers.force_sensor.weighing import Load, weigh, weigh_connected
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.errors import DeviceError
from tests.mock.bench import MockBench, SimulatedClock
from tests.mock.world import MockWorld

WEIGHT_N = 1.962


@pytest.fixture
def bench() -> MockBench:
    """Return a laboratory in memory."""
    return MockBench.on(MockWorld(SimulatedClock(), load_config().config))


def test_the_three_readings_are_those_of_the_world(bench: MockBench) -> None:
    """Bias, weight and noise are read; what happened before the word is not."""
    world, asked = bench.world, []

    def ask(load: Load) -> None:
        asked.append(load)
        world.clock.sleep(5.0)  # an operator takes a while; none of that is weighed
        pull = -WEIGHT_N if load is Load.WEIGHT else 0.0
        world.disturbance = (0.0, 0.0, pull, 0.0, 0.0, 0.0)

    before, loaded, after = weigh_connected(bench.force_sensor, world.clock, world.config, ask=ask)
    assert asked == list(Load)
    assert loaded.mean[2] - before.mean[2] == pytest.approx(-WEIGHT_N, abs=0.01)
    assert after.mean[2] == pytest.approx(before.mean[2], abs=0.02)
    assert before.deviation[2] == pytest.approx(world.noise_n, rel=0.3)
    assert before.sample_count == pytest.approx(200, abs=2)


@pytest.mark.parametrize(
    ("fault", "load_n", "message"),
    [
        ("force_sensor:stall", 0.0, "0 samples in 2 s"),
        ("force_sensor:scale=1", math.nan, "that is not a number"),
        ("force_sensor:saturate", 0.0, "beyond its capacity 50 N"),
    ],
)
def test_a_cell_that_cannot_be_weighed_with_is_named(
    bench: MockBench, fault: str, load_n: float, message: str
) -> None:
    """Before anything is compared with a weight."""
    bench.world.disturbance = (0.0, 0.0, load_n, 0.0, 0.0, 0.0)
    bench.world.begin(fault)
    with pytest.raises(DeviceError, match=message):
        weigh_connected(
            bench.force_sensor, bench.world.clock, bench.world.config, ask=lambda _: None
        )


def test_an_emulated_weight_is_felt_by_the_real_driver(
    run_box, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It hangs while it is told to, and is gone afterwards."""
    monkeypatch.setattr(weighing, "SETTLE_S", 0.2)
    monkeypatch.setattr(weighing, "WEIGH_S", 0.5)
    with run_box(tmp_path) as port:
        given = ['force_sensor.driver="m3733c"', f'force_sensor.port="{port}"']
        given += ['force_sensor.capacity="50 N"', 'force_sensor.calibration_sheet="none"']
        config = load_config(overrides=given).config
        before, loaded, after = weigh(
            config, ask=lambda load: hang_weight(tmp_path, 0.2 if load is Load.WEIGHT else 0.0)
        )
    assert loaded.mean[2] - before.mean[2] == pytest.approx(-0.2 * 9.81, abs=0.01)
    assert math.isclose(after.mean[2], before.mean[2], abs_tol=0.01)
