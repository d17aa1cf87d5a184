"""What the protocol may ask of a device; real, emulated and mock devices all answer to it.

No call here blocks longer than its stated deadline. Reads return what has already arrived;
whether that is too old is judged by age, never by waiting.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from tacauchy_rig.run import ArmSample, ForceSample, ImageFrame, Pose, Vector6


class Clock(Protocol):
    """The one clock of a run: the host's monotonic clock, or a simulated one in mocks."""

    def now_ns(self) -> int:
        """Return nanoseconds since an arbitrary start."""
        ...

    def sleep(self, duration_s: float) -> None:
        """Wait for ``duration_s`` [s]."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceIdentity:
    """Who answered: goes into every record.

    Attributes:
        simulated: True for emulators and mocks, so that a report can say so.
    """

    driver: str
    address: str
    model: str
    serial: str
    simulated: bool
    settings: dict[str, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamHealth:
    """How well a stream has been arriving since it was started.

    Attributes:
        age_s: Since the newest sample arrived; infinite before the first.
        lost_count: Samples that the device counted and this host never saw.
        corrupt_count: Bytes or frames dropped because length or checksum disagreed.
        repeat_count: Longest run of identical consecutive samples, now.
        clipped_ratio: Share of the newest judged image that is at full scale; 0 for other streams.
    """

    received_count: int
    lost_count: int
    corrupt_count: int
    repeat_count: int
    age_s: float
    rate_hz: float
    clipped_ratio: float = 0.0


class Arm(Protocol):
    """A robot arm with the indenter's tip as tool centre point. One owner, one thread."""

    def connect(self) -> DeviceIdentity:
        """Connect with a deadline.

        Raises:
            DeviceError: Unreachable, not in remote control, not powered, or already in use.
        """
        ...

    def state(self) -> ArmSample:
        """Return the newest state.

        Raises:
            DeviceError: The controller's time stamp has stopped moving, the connection is gone,
                or the program on the controller ended (protective stop, emergency stop).
        """
        ...

    def drain(self) -> list[ArmSample]:
        """Return the states that arrived since the last call, oldest first, for the record."""
        ...

    def is_pose_allowed(self, pose: Pose) -> bool:
        """Ask the controller whether its safety limits admit ``pose``."""
        ...

    def start_move(self, target: Pose, *, speed: float, acceleration: float) -> None:
        """Start a straight tool move [m/s, m/s^2] and return at once."""
        ...

    def is_moving(self) -> bool:
        """Return True until the move started last has ended."""
        ...

    def set_velocity(self, velocity: Vector6, *, acceleration: float) -> None:
        """Set the tool velocity [m/s, rad/s]; holds until changed or stopped."""
        ...

    def kick_watchdog(self) -> None:
        """Tell the controller that this program lives; must be called at 10 Hz or faster."""
        ...

    def stop(self) -> None:
        """End any motion. Never raises; returns within 0.2 s."""
        ...

    def protective_stop(self) -> None:
        """Trigger the controller's protective stop. A person has to unlock it."""
        ...

    def close(self) -> None:
        """Stop, end the program on the controller and disconnect. Safe to call twice."""
        ...


class ForceTorqueSensor(Protocol):
    """A six-axis force/torque sensor that streams by itself."""

    def connect(self) -> DeviceIdentity:
        """Open, identify, start streaming, and see the first frame before the deadline.

        Raises:
            DeviceError: Absent, no permission, in use, silent, or speaking something else.
        """
        ...

    def drain(self) -> list[ForceSample]:
        """Return every sample that arrived since the last call, oldest first; never blocks.

        Raises:
            DeviceError: The port is gone.
        """
        ...

    def health(self) -> StreamHealth:
        """Return counts, age and rate of the stream."""
        ...

    def close(self) -> None:
        """Stop streaming and release the port. Safe to call twice."""
        ...


class Camera(Protocol):
    """A camera that delivers JPEG frames as they come."""

    def connect(self) -> DeviceIdentity:
        """Open, set the mode, read it back, and see the first frame before the deadline.

        Raises:
            DeviceError: Absent, no permission, in use, silent, or in another mode than asked.
        """
        ...

    def drain(self) -> list[ImageFrame]:
        """Return every frame that arrived since the last call, oldest first; never blocks.

        Raises:
            DeviceError: The camera is gone.
        """
        ...

    def health(self) -> StreamHealth:
        """Return counts, age and rate of the stream."""
        ...

    def close(self) -> None:
        """Release the camera. Safe to call twice."""
        ...
