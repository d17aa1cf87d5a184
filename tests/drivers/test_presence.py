"""What is missing is told at once, before a person is asked for anything."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from drivers.presence import missing_devices, require_devices
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.config.model import RigConfig, RobotModel
from tacauchy_rig.core.config.rules import ARM_REQUIRES
from tacauchy_rig.core.errors import DeviceError


def real(**devices: str) -> RigConfig:
    """Return a configuration of real devices: host, port and camera, each where it is given."""
    written = load_config().written
    given = {}
    if "host" in devices:
        given = {"robot.driver": "ur5", "robot.host": devices["host"]}
        given |= {field: written[field] for field in ARM_REQUIRES}
        given["robot.connect_timeout"] = "3 s"
    if "port" in devices:
        given |= {"force_sensor.driver": "m3733c", "force_sensor.port": devices["port"]}
        given |= {"force_sensor.capacity": "50 N", "force_sensor.calibration_sheet": "none"}
    if "camera" in devices:
        given |= {"camera.driver": "uvc", "camera.device": devices["camera"]}
        given["camera.connect_timeout"] = "2 s"
    return load_config(overrides=[f"{k}={json.dumps(v)}" for k, v in given.items()]).config


def test_all_that_is_missing_is_told_together(tmp_path: Path) -> None:
    """A person who has three cables to plug in is told of three."""
    gone = str(tmp_path / "ttyUSB7")
    with pytest.raises(DeviceError) as caught:
        require_devices(real(host="127.0.0.99", port=gone, camera="http://127.0.0.1:9/none"))
    lines = [line for line in str(caught.value).split("\n") if not line.startswith("  -> ")]
    assert [line.split()[0].rstrip(":") for line in lines] == ["robot", "force", "camera"]
    assert gone in lines[1]
    assert str(caught.value).count("  -> ") == 3


def test_devices_that_the_run_starts_are_not_asked() -> None:
    """A dry run has nothing to plug in."""
    config = load_config().config
    assert not any(each.is_real for each in (config.robot, config.force_sensor, config.camera))
    assert list(missing_devices(config)) == []


def test_those_that_are_there_pass(emulate_ur, run_box, tmp_path: Path) -> None:
    """A ready controller and a streaming box answer, and are let go of again."""
    robot = emulate_ur(RobotModel.E_SERIES)
    with run_box(tmp_path) as port:
        config = real(host=robot.host, port=port)
        assert list(missing_devices(config)) == []
        assert list(missing_devices(config)) == []
