"""Is every real device there, before a person is asked for anything? Nothing moves or is set."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from drivers.arm.interface import Arm
from drivers.arm.ur5_probe import probe_controller, require_ready
from drivers.camera.interface import Camera
from drivers.force_sensor.interface import ForceTorqueSensor
from tacauchy_rig.core.config.model import DeviceSection, RigConfig
from tacauchy_rig.core.errors import DeviceError, RigError
from tacauchy_rig.core.registry import Kind, load


def require_devices(config: RigConfig) -> None:
    """Ask the arm's controller, see a frame of the force sensor and one of the camera.

    Devices that the run itself starts are passed over.

    Raises:
        DeviceError: One or more do not answer; each is named with what to do.
    """
    errors = list(missing_devices(config))
    if errors:
        raise DeviceError("\n".join(map(str, errors)))  # each with its own remedy below it


def missing_devices(config: RigConfig) -> Iterator[RigError]:
    """Yield why a device does not answer, for each that does not."""
    looks: tuple[tuple[DeviceSection, Callable[[RigConfig], None]], ...] = (
        (config.robot, _ask_arm),
        (config.force_sensor, _ask_force_sensor),
        (config.camera, _ask_camera),
    )
    for section, look in looks:
        if section.is_real:
            try:
                look(config)
            except RigError as error:
                yield error


def _ask_arm(config: RigConfig) -> None:
    robot = config.robot
    if robot.driver == "ur5":
        report = probe_controller(robot.host, timeout_s=robot.connect_timeout)
        require_ready(report, model=robot.model)
        return
    arm: Arm = load(Kind.ARM, robot.driver)(config)
    try:
        arm.connect()
        arm.state()
    finally:
        arm.close()


def _ask_force_sensor(config: RigConfig) -> None:
    sensor: ForceTorqueSensor = load(Kind.FORCE_SENSOR, config.force_sensor.driver)(config, None)
    try:
        sensor.connect()
    finally:
        sensor.close()


def _ask_camera(config: RigConfig) -> None:
    camera: Camera = load(Kind.CAMERA, config.camera.driver)(config)
    try:
        camera.connect()
    finally:
        camera.close()
