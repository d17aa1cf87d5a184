"""From a configuration to devices: the one place that knows which class answers to which name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from drivers.arm.interface import Arm
from drivers.arm.ur5 import Ur5
from drivers.camera.interface import Camera
from drivers.camera.uvc import CameraMode, UvcCamera
from drivers.device.clock import Clock, HostClock
from drivers.device.interface import StreamHealth
from drivers.force_sensor.interface import ForceTorqueSensor
from drivers.force_sensor.sri_m3733c import SriM3733c
from drivers.mock.arm import MockArm
from drivers.mock.camera import MockCamera
from drivers.mock.fault_plan import plan_faults
from drivers.mock.force_sensor import MockForceSensor
from drivers.mock.world import MockWorld
from tacauchy_rig.config.model import CameraDriver, ForceSensorDriver, RigConfig, RobotDriver
from tacauchy_rig.errors import ConfigError


@dataclass(frozen=True, slots=True)
class FrameMark:
    """That a frame arrived; the frame itself goes to the record on its own way."""

    stamp_ns: int
    counter: int


class CameraMonitor(Protocol):
    """What the control loop may know of a camera that another process may own."""

    def poll(self) -> list[FrameMark]:
        """Return marks of the frames that arrived since the last call; never blocks.

        Raises:
            DeviceError: The camera, or the process that owns it, is gone.
        """
        ...

    def health(self) -> StreamHealth:
        """Return counts, age and rate of the stream."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Rig:
    """Everything a trial needs of the laboratory, connected."""

    arm: Arm
    force_sensor: ForceTorqueSensor
    camera: CameraMonitor
    clock: Clock


def build_arm_and_force_sensor(config: RigConfig) -> tuple[Arm, ForceTorqueSensor]:
    """Return both, not yet connected. Mocks share a world that runs on the host's clock.

    Raises:
        ConfigError: A mock beside a device that is none: it could not feel it.
    """
    mocks = config.robot.driver is RobotDriver.MOCK
    if mocks != (config.force_sensor.driver is ForceSensorDriver.MOCK):
        raise ConfigError(
            f'robot.driver = "{config.robot.driver}" with force_sensor.driver = '
            f'"{config.force_sensor.driver}": a mock feels no device of another process',
            remedy='make both "mock", or use "emulated" beside a real device',
        )
    if not mocks:
        return _ur5(config), _m3733c(config)
    world = MockWorld(HostClock(), config)
    arm, force_sensor = MockArm(world), MockForceSensor(world)
    plan_faults(world, config.emulation.faults, lock_arm=arm.protective_stop)
    return arm, force_sensor


def build_camera(config: RigConfig) -> Camera:
    """Return the camera, not yet connected; an emulated one is the real driver at its address."""
    camera = config.camera
    if camera.driver is CameraDriver.MOCK:
        world = MockWorld(HostClock(), config)
        mock = MockCamera(world)
        plan_faults(world, config.emulation.faults)
        return mock
    return UvcCamera(
        camera.device,
        mode=CameraMode(
            width=camera.width,
            height=camera.height,
            rate_hz=camera.rate,
            exposure=camera.exposure,
            gain=camera.gain,
            white_balance=camera.white_balance,
        ),
        connect_timeout_s=camera.connect_timeout,
        simulated=camera.driver is CameraDriver.EMULATED,
    )


def _ur5(config: RigConfig) -> Ur5:
    robot = config.robot
    fastest = max(robot.approach_speed, robot.search_speed, robot.press_speed, robot.retract_speed)
    return Ur5(
        host=robot.host,
        model=robot.model,
        max_speed=fastest,
        max_acceleration=robot.acceleration,
        tcp_offset=(*robot.tcp_offset, 0.0, 0.0, 0.0),
        payload_kg=robot.payload,
        timeout_s=robot.connect_timeout,
        stale_limit_s=config.limits.stale_robot,
        watchdog_hz=config.robot.watchdog,
        simulated=robot.driver is RobotDriver.EMULATED,
    )


def _m3733c(config: RigConfig) -> SriM3733c:
    sensor = config.force_sensor
    return SriM3733c(
        sensor.port,
        baud_rate=sensor.baud_rate,
        rate_hz=sensor.rate,
        checksum=sensor.checksum,
        connect_timeout_s=sensor.connect_timeout,
        simulated=sensor.driver is ForceSensorDriver.EMULATED,
    )
