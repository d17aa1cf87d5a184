"""Checks of the devices that a configuration names, one after the other; nothing moves."""

from __future__ import annotations

from pathlib import Path

from drivers.arm.checks import robot_checks
from drivers.camera.checks import camera_checks
from drivers.force_sensor.checks import force_sensor_checks
from tacauchy_rig.config.model import DeviceSection, RigConfig
from tacauchy_rig.doctor.result import CheckResult, skipped


def device_checks(
    config: RigConfig, *, measure_s: float = 2.0, sys_folder: Path = Path("/sys")
) -> list[CheckResult]:
    """Look at every real device; never raises, because what is wrong is the result.

    Args:
        config: Where the devices are and what is asked of them.
        measure_s: How long each stream is measured [s].
        sys_folder: Where the kernel tells about adapters and cameras.
    """
    robot, force_sensor, camera = config.robot, config.force_sensor, config.camera
    results = robot_checks(config) if robot.is_real else [_not_real("robot", robot)]
    if force_sensor.is_real:
        results += force_sensor_checks(config, measure_s=measure_s, sys_folder=sys_folder)
    else:
        results.append(_not_real("force_sensor", force_sensor))
    if camera.is_real:
        results += camera_checks(config, measure_s=measure_s)
    else:
        results.append(_not_real("camera", camera))
    return results


def _not_real(name: str, device: DeviceSection) -> CheckResult:
    return skipped(
        name, f'driver = "{device.driver}": it starts with the run, there is nothing to check'
    )
