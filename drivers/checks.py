"""Checks of the devices that a configuration names, one after the other; nothing moves."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from drivers.arm.checks import robot_checks
from drivers.camera.checks import camera_checks
from drivers.force_sensor.checks import force_sensor_checks
from tacauchy_rig.core.check_result import CheckResult, skipped
from tacauchy_rig.core.config.model import DeviceSection, RigConfig


def device_checks(
    config: RigConfig, *, measure_s: float = 2.0, sys_folder: Path = Path("/sys")
) -> list[CheckResult]:
    """Look at every real device; never raises, because what is wrong is the result.

    Args:
        config: Where the devices are and what is asked of them.
        measure_s: How long each stream is measured [s].
        sys_folder: Where the kernel tells about adapters and cameras.
    """
    looks: dict[str, Callable[[], list[CheckResult]]] = {
        "robot": lambda: robot_checks(config),
        "force_sensor": lambda: force_sensor_checks(
            config, measure_s=measure_s, sys_folder=sys_folder
        ),
        "camera": lambda: camera_checks(config, measure_s=measure_s),
    }
    results: list[CheckResult] = []
    for name, look in looks.items():
        device: DeviceSection = getattr(config, name)
        found = f'driver = "{device.driver}": it starts with the run, there is nothing to check'
        results += look() if device.is_real else [skipped(name, found)]
    return results
