"""From a configuration to the right device classes."""

from __future__ import annotations

import pytest

from drivers.arm.ur5 import Ur5
from drivers.camera.uvc import UvcCamera
from drivers.force_sensor.sri_m3733c import SriM3733c
from drivers.interfaces import build_arm_and_force_sensor, build_camera
from drivers.mock.arm import MockArm
from drivers.mock.streams import MockCamera, MockForceSensor
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.errors import ConfigError


def test_mocks_share_one_world():
    """A mock force sensor feels what the mock arm does."""
    config = load_config(
        overrides=['robot.driver="mock"', 'force_sensor.driver="mock"', 'camera.driver="mock"']
    ).config
    arm, sensor = build_arm_and_force_sensor(config)
    assert isinstance(arm, MockArm)
    assert isinstance(sensor, MockForceSensor)
    assert arm.world is sensor.world
    assert isinstance(build_camera(config), MockCamera)


def test_emulated_devices_are_the_real_drivers():
    """The product cannot tell an emulator from a rig."""
    config = load_config().config
    arm, sensor = build_arm_and_force_sensor(config)
    assert isinstance(arm, Ur5)
    assert isinstance(sensor, SriM3733c)
    assert isinstance(build_camera(config), UvcCamera)


def test_a_mock_beside_another_device_is_refused():
    """A mock force sensor could not feel an emulated arm."""
    config = load_config(overrides=['force_sensor.driver="mock"']).config
    with pytest.raises(ConfigError, match="a mock feels no device of another process"):
        build_arm_and_force_sensor(config)
