"""The mock force sensor and camera stream as the interfaces promise, and fail on demand."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from drivers.emulators.faults import parse_fault
from drivers.mock.streams import HEIGHT, WIDTH
from tacauchy_rig.core.errors import DeviceError


@pytest.mark.parametrize(
    ("plan", "age_s"), [("force_sensor:stall@1s", 1.0), ("force_sensor:stall@1s+500ms", 0.0)]
)
def test_planned_faults_begin_and_end(bench, plan, age_s):
    """Written as for the emulators: what stalls for half a second comes back."""
    bench.world.plan([plan])
    bench.world.clock.sleep(2.0 - bench.world.elapsed_s)
    assert bench.force_sensor.health().age_s == pytest.approx(age_s, abs=0.02)


def test_what_lies_begins_and_ends_as_planned(bench):
    """Reads a tenth for a second, and the truth before and after."""
    bench.world.noise_n = bench.world.drift_n_s = 0.0
    bench.world.plan(["force_sensor:scale=0.1@1s+1s"])
    bench.force_sensor.drain()
    bench.world.clock.sleep(3.0 - bench.world.elapsed_s)
    said = [sample.wrench[2] for sample in bench.force_sensor.drain()]
    true = bench.world.bias[2]
    assert said.count(pytest.approx(0.1 * true)) == pytest.approx(100, abs=1)
    assert said.count(pytest.approx(true)) == len(said) - said.count(pytest.approx(0.1 * true))
    assert said[-1] == pytest.approx(true)


def test_no_frame_is_like_another_until_the_camera_lies(bench):
    """Each frame's bytes are its own; a frozen camera repeats one, and its health says so."""
    bench.world.clock.sleep(1.0)
    frames = bench.camera.drain()
    assert len({frame.jpeg for frame in frames}) == len(frames)
    assert bench.camera.health().repeat_count == 1
    bench.world.begin(parse_fault("camera:freeze-image"))
    bench.world.clock.sleep(1.0)
    frames = bench.camera.drain()
    assert len({frame.jpeg for frame in frames}) == 1
    assert len({frame.counter for frame in frames}) == len(frames)
    assert bench.camera.health().repeat_count == len(frames)


def test_a_touch_shows_in_the_image(bench):
    """Where the gel is pressed, the middle of the image is darker."""

    def middle():
        bench.world.clock.sleep(0.1)
        jpeg = bench.camera.drain()[-1].jpeg
        image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
        return float(image[HEIGHT // 2, WIDTH // 2])

    free = middle()
    bench.world.pose = bench.world.pose.shifted(
        z=bench.world.surface_z_m - 0.0005 - bench.world.pose.position[2]
    )
    assert free - middle() > 40.0


def test_failures_show_as_on_real_devices(bench):
    """NaN, saturation, repeats, losses and unplugging."""
    sensor, world = bench.force_sensor, bench.world

    def newest():
        bench.world.clock.sleep(0.5)
        return sensor.drain()

    world.disturbance = (0.0, 0.0, math.nan, 0.0, 0.0, 0.0)
    assert math.isnan(newest()[-1].wrench[2])
    world.disturbance = (0.0,) * 6
    world.begin("force_sensor:saturate")
    assert newest()[-1].wrench[2] == bench.world.config.force_sensor.capacity
    world.begin("force_sensor:freeze")
    assert len({sample.wrench for sample in newest()[1:]}) == 1
    world.begin("force_sensor:drop")
    newest()
    assert sensor.health().lost_count == 5
    world.begin("force_sensor:unplug")
    with pytest.raises(DeviceError):
        sensor.drain()
    world.begin("camera:unplug")
    with pytest.raises(DeviceError):
        bench.camera.drain()
