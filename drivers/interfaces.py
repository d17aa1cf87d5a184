"""Interfaces of arm, force sensor and camera, and the rig that they form.

No call of a device blocks longer than its stated deadline. Reads return what has already arrived;
whether that is too old is judged by age, never by waiting.
"""

import math
import time
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol, TypeVar

from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.registry import Kind, load
from tacauchy_rig.core.run import ArmSample, ForceSample, ImageFrame, Pose, Vector6


class Clock:
    """Stamps all arriving data: ``time.monotonic_ns``, the same in every process of this host."""

    def now_ns(self) -> int:
        """Return nanoseconds of the host's monotonic clock."""
        return time.monotonic_ns()

    def sleep(self, duration_s: float) -> None:
        """Wait for ``duration_s`` [s]; nothing at or below zero."""
        if duration_s > 0.0:
            time.sleep(duration_s)


SampleT = TypeVar("SampleT")


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceIdentity:
    """Identity of a connected device, recorded with every run."""

    driver: str
    address: str
    model: str
    serial: str
    simulated: bool  # true for emulators, so that a report can say so
    settings: dict[str, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamHealth:
    """State of a stream since its start."""

    received_count: int = 0
    lost_count: int = 0  # samples that the device counted and this host never saw
    corrupt_count: int = 0  # bytes or frames dropped because length or checksum disagreed
    repeat_count: int = 0  # longest run of identical consecutive samples, now
    age_s: float = math.inf  # time since the newest sample arrived [s]; infinite before the first
    rate_hz: float = 0.0
    # Share of the newest judged image that is at full scale; 0 for other streams.
    clipped_ratio: float = 0.0


MANUAL_EXPOSURE = 1.0
"""V4L2_EXPOSURE_MANUAL in a camera's ``auto_exposure``; 3 is aperture priority, the usual one."""


class StreamingDevice(Protocol[SampleT]):
    """A device that sends samples by itself; a reader thread collects them."""

    def connect(self) -> DeviceIdentity:
        """Open, identify, configure and start the device; return after the first sample.

        Raises:
            DeviceError: Absent, no permission, in use, silent, speaking something else, or in
                another mode than asked.
        """

    def drain(self) -> list[SampleT]:
        """Return every sample that arrived since the last call, oldest first; never blocks.

        Raises:
            DeviceError: The device is gone; raised after all earlier samples were returned.
        """

    def health(self) -> StreamHealth:
        """Return counts, age and rate of the stream."""

    def close(self) -> None:
        """Stop the stream and release the device. Safe to call twice."""


class ProgramEndedError(DeviceError):
    """The robot's own program ended without a stop: its watchdog was not fed, or a person did."""


class Arm(Protocol):
    """A robot arm with the indenter's tip as tool centre point. One owner, one thread."""

    def connect(self) -> DeviceIdentity:
        """Connect with a deadline.

        Raises:
            DeviceError: Unreachable, not in remote control, not powered, or already in use.
        """

    def state(self) -> ArmSample:
        """Return the newest state.

        Raises:
            DeviceError: The controller's time stamp has stopped moving, the connection is gone,
                or the program on the controller ended (protective stop, emergency stop).
        """

    def drain(self) -> list[ArmSample]:
        """Return the states that arrived since the last call, oldest first, for the record."""

    def is_pose_allowed(self, pose: Pose) -> bool:
        """Ask the controller whether its safety limits admit ``pose``."""

    def start_move(self, target: Pose, *, speed: float, acceleration: float) -> None:
        """Start a straight tool move [m/s, m/s^2] and return at once."""

    def is_moving(self) -> bool:
        """Return True until the move started last has ended."""

    def set_velocity(self, velocity: Vector6, *, acceleration: float) -> None:
        """Set the tool velocity [m/s, rad/s]; holds until changed or stopped."""

    def kick_watchdog(self) -> None:
        """Tell the controller that this program lives; must be called at 10 Hz or faster."""

    def stop(self) -> None:
        """End any motion. Never raises; returns within 0.2 s."""

    def protective_stop(self) -> None:
        """Trigger the controller's protective stop. A person has to unlock it."""

    def close(self) -> None:
        """Stop, end the program on the controller and disconnect. Safe to call twice."""


class ForceTorqueSensor(StreamingDevice[ForceSample], Protocol):
    """A six-axis force/torque sensor that streams by itself."""


class Camera(StreamingDevice[ImageFrame], Protocol):
    """A camera that delivers JPEG frames as they come."""


@dataclass(frozen=True, slots=True)
class FrameMark:
    """That a frame arrived; the frame itself goes to the record on its own way."""

    stamp_ns: int
    counter: int
    digest: int = 0  # of the frame's bytes: equal ones are the same picture, noise included
    # Whether the picture differs from those without contact, where that was asked for.
    touched: bool = False


class TouchMode(StrEnum):
    """What a camera is asked: nothing, to learn the gel without contact, or to see touches."""

    NOTHING = "nothing"
    REFERENCE = "reference"
    TOUCH = "touch"


class CameraMonitor(Protocol):
    """What the control loop may know of a camera that another process may own."""

    def poll(self) -> list[FrameMark]:
        """Return marks of the frames that arrived since the last call; never blocks.

        Raises:
            DeviceError: The camera, or the process that owns it, is gone.
        """

    def health(self) -> StreamHealth:
        """Return counts, age and rate of the stream."""

    def ask(self, mode: TouchMode) -> None:
        """Let later marks say whether the gel is touched, or stop asking; never blocks."""


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
        ConfigError: A driver is unknown or does not import.
    """
    arm: Arm = load(Kind.ARM, config.robot.driver)(config)
    return arm, load(Kind.FORCE_SENSOR, config.force_sensor.driver)(config, arm)


def build_camera(config: RigConfig) -> Camera:
    """Return the camera, not yet connected.

    Raises:
        ConfigError: The driver is unknown or does not import.
    """
    camera: Camera = load(Kind.CAMERA, config.camera.driver)(config)
    return camera
