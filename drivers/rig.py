"""The devices that a configuration names, built through the registry, and the rig they make."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from drivers.arm.interface import Arm
from drivers.camera.interface import Camera
from drivers.camera.touch import Look
from drivers.device.interface import Clock, StreamHealth
from drivers.force_sensor.interface import ForceTorqueSensor
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.registry import Kind, load


@dataclass(frozen=True, slots=True)
class FrameMark:
    """That a frame arrived; the frame itself goes to the record on its own way.

    Attributes:
        digest: Of the frame's bytes: equal ones are the same picture, noise included.
        touched: Whether the picture differs from those without contact, where that was asked for.
    """

    stamp_ns: int
    counter: int
    digest: int = 0
    touched: bool = False


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

    def ask(self, look: Look) -> None:
        """Let later marks say whether the gel is touched, or stop asking; never blocks."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Rig:
    """Everything a trial needs of the laboratory, connected."""

    arm: Arm
    force_sensor: ForceTorqueSensor
    camera: CameraMonitor
    clock: Clock


def build_arm_and_force_sensor(config: RigConfig) -> tuple[Arm, ForceTorqueSensor]:
    """Return both, not yet connected; the sensor is told which arm carries it.

    Raises:
        ConfigError: A driver is unknown or does not import, or a mock stands beside a device that
            is none.
    """
    arm: Arm = load(Kind.ARM, config.robot.driver)(config)
    force_sensor: ForceTorqueSensor = load(Kind.FORCE_SENSOR, config.force_sensor.driver)(
        config, arm
    )
    return arm, force_sensor


def build_camera(config: RigConfig) -> Camera:
    """Return the camera, not yet connected.

    Raises:
        ConfigError: The driver is unknown or does not import.
    """
    camera: Camera = load(Kind.CAMERA, config.camera.driver)(config)
    return camera
