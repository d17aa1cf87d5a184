"""From a configuration to devices: the one place that knows which class answers to which name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from drivers.interfaces import Arm, Clock, ForceTorqueSensor, StreamHealth


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
