"""From a configuration to the right device classes."""

from __future__ import annotations

from drivers.arm.ur5 import Ur5
from drivers.camera.uvc import UvcCamera
from drivers.force_sensor.sri_m3733c import SriM3733c
from drivers.interfaces import build_arm_and_force_sensor, build_camera
from tacauchy_rig.core.config.load import load_config


def test_emulated_devices_are_the_real_drivers():
    """The product cannot tell an emulator from a rig."""
    config = load_config().config
    arm, sensor = build_arm_and_force_sensor(config)
    assert isinstance(arm, Ur5)
    assert isinstance(sensor, SriM3733c)
    assert isinstance(build_camera(config), UvcCamera)
