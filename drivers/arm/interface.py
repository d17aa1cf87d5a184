"""What the protocol may ask of an arm; real, emulated and mock arms all answer to it."""

from __future__ import annotations

from typing import Protocol

from drivers.device.interface import DeviceIdentity
from tacauchy_rig.core.run import ArmSample, Pose, Vector6


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
