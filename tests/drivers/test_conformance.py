"""Mock and emulated devices keep every promise of their interfaces; one that does not is named."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.arm.ur5_motion_and_watchdog import Ur5
from drivers.camera.uvc_camera import UvcCamera
from drivers.conformance import (
    ARM_CHECKS,
    LOCKING_ARM_CHECKS,
    NotConformingError,
    camera_streams,
    force_sensor_streams,
)
from drivers.emulators.faults import Device
from drivers.emulators.launch import Emulation
from drivers.force_sensor.sri_m3733c import SriM3733c
from drivers.interfaces import build_arm_and_force_sensor, build_camera
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.config.settings import RigConfig
from tests.mock.arm import MockArm
from tests.mock.streams import MockCamera, MockForceSensor

LAX = (
    'robot.watchdog="2 Hz"',
    'limits.stale_robot="500 ms"',
    "camera.width=320",
    "camera.height=240",
)

# ur_rtde holds the interpreter lock in its constructors, so its arm has a process of its own.
_RUN_ARM_CHECKS = """
import sys
from drivers.conformance import ARM_CHECKS, LOCKING_ARM_CHECKS
from drivers.interfaces import build_arm_and_force_sensor
from tacauchy_rig.core.config.load import load_config

config = load_config(overrides=sys.argv[1:]).config
for check in (*ARM_CHECKS, *LOCKING_ARM_CHECKS):
    check(lambda: build_arm_and_force_sensor(config)[0])
    print(check.__name__, flush=True)
"""


@pytest.fixture(scope="module")
def emulated(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RigConfig]:
    """Return the configuration of emulated devices that run."""
    config = load_config(overrides=LAX).config
    folder = tmp_path_factory.mktemp("emulated")
    with Emulation(config, folder=folder, devices=frozenset(Device)) as emulation:
        yield emulation.running


@pytest.mark.parametrize(
    "check", [*ARM_CHECKS, *LOCKING_ARM_CHECKS], ids=lambda check: check.__name__
)
def test_a_mock_arm_conforms(check: Callable[..., None]) -> None:
    """On the host's clock."""
    config = load_config().config
    check(lambda: MockArm.from_config(config))


def test_mock_streams_conform() -> None:
    """Force sensor and camera."""
    config = load_config().config
    force_sensor_streams(
        lambda: MockForceSensor.from_config(config, MockArm.from_config(config)),
        rate_hz=config.force_sensor.rate,
    )
    camera_streams(lambda: MockCamera.from_config(config), rate_hz=config.camera.rate)


@pytest.mark.slow
def test_an_emulated_arm_conforms(emulated: RigConfig) -> None:
    """The real driver, as far as an emulated controller can tell."""
    settings = [*LAX, f"robot.host={emulated.robot.host}"]
    done = subprocess.run(
        [sys.executable, "-c", _RUN_ARM_CHECKS, *settings],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    for check in (*ARM_CHECKS, *LOCKING_ARM_CHECKS):
        assert check.__name__ in done.stdout


def test_emulated_streams_conform(emulated: RigConfig) -> None:
    """The real drivers of force sensor and camera."""
    force_sensor_streams(
        lambda: build_arm_and_force_sensor(emulated)[1], rate_hz=emulated.force_sensor.rate
    )
    camera_streams(lambda: build_camera(emulated), rate_hz=emulated.camera.rate)


def test_a_broken_promise_is_named() -> None:
    """An arm that never stops by itself is found out, in words."""

    class Unfed(MockArm):
        def state(self) -> Any:
            self.kick_watchdog()
            return super().state()

        def stop(self) -> None:
            """Do nothing."""

    config = load_config().config
    (check,) = (check for check in ARM_CHECKS if "until_stopped" in check.__name__)
    with pytest.raises(NotConformingError, match="rests after stop"):
        check(lambda: Unfed.from_config(config))


@pytest.mark.parametrize(
    ("changes", "promise"),
    [({"age_s": -1.8e9}, "monotonic"), ({"repeat_count": 99}, "fingerprints")],
)
def test_another_clock_or_a_constant_fingerprint_is_found_out(changes, promise, monkeypatch):
    """Either would hide a force sensor that fails while it measures."""
    config, told = load_config().config, MockForceSensor.health
    monkeypatch.setattr(MockForceSensor, "health", lambda self: replace(told(self), **changes))
    with pytest.raises(NotConformingError, match=promise):
        force_sensor_streams(
            lambda: MockForceSensor.from_config(config, MockArm.from_config(config)),
            rate_hz=config.force_sensor.rate,
        )


def test_emulated_devices_are_the_real_drivers():
    """The product cannot tell an emulator from a rig."""
    config = load_config().config
    arm, sensor = build_arm_and_force_sensor(config)
    assert isinstance(arm, Ur5)
    assert isinstance(sensor, SriM3733c)
    assert isinstance(build_camera(config), UvcCamera)
