"""The control loop's sink and camera when recorder and camera are other processes."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace

from drivers.interfaces import StreamHealth
from drivers.rig import FrameMark
from protocols.processes.channel import Channel
from protocols.processes.entry import Arm, Begin, End, Event, Force
from protocols.processes.link import RecorderLink
from protocols.processes.messages import CameraStatus, Failed
from tacauchy_rig.errors import DeviceError
from tacauchy_rig.run import ArmSample, ForceSample, JournalEvent, TrialRecord


class LinkSink:
    """Queues everything for the recorder; see ``Sink``."""

    def __init__(self, link: RecorderLink) -> None:
        self._link = link

    def begin_attempt(self, trial: int, attempt: int) -> None:
        """Start the recording of an attempt."""
        self._link.put(Begin(trial, attempt))

    def force(self, samples: Sequence[ForceSample]) -> None:
        """Record force samples."""
        self._link.put(Force(tuple(samples)))

    def arm(self, samples: Sequence[ArmSample]) -> None:
        """Record arm states."""
        self._link.put(Arm(tuple(samples)))

    def event(self, event: JournalEvent) -> None:
        """Record a line of the journal."""
        self._link.put(Event(event))

    def end_attempt(self, record: TrialRecord) -> None:
        """Keep the result."""
        self._link.put(End(record, time.monotonic_ns()))

    def problem(self) -> str:
        """Return what is wrong with the recorder."""
        return self._link.problem()

    def lag_s(self) -> float:
        """Return how far the recorder is behind [s]."""
        return self._link.lag_s()


class RemoteCamera:
    """Watches the camera process by its status messages; see ``CameraMonitor``."""

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._health = StreamHealth(
            received_count=0,
            lost_count=0,
            corrupt_count=0,
            repeat_count=0,
            age_s=math.inf,
            rate_hz=0.0,
        )
        self._newest_ns: int | None = None

    def poll(self) -> list[FrameMark]:
        """Return the marks that arrived.

        Raises:
            DeviceError: The camera is gone, or its process is.
        """
        marks: list[FrameMark] = []
        for message in self._channel.receive():
            if isinstance(message, Failed):
                raise DeviceError(message.message, remedy=message.remedy)
            if isinstance(message, CameraStatus):
                marks += message.marks
                self._health = message.health
        if marks:
            self._newest_ns = marks[-1].stamp_ns
        if self._channel.closed:
            raise DeviceError(
                "camera: its process is gone",
                remedy="read logs/camera.log in the run folder, then `tacauchy-rig resume`",
            )
        return marks

    def health(self) -> StreamHealth:
        """Return counts and rate as last reported, and the age as it is now."""
        newest_ns = self._newest_ns
        age_s = math.inf if newest_ns is None else (time.monotonic_ns() - newest_ns) * 1e-9
        return replace(self._health, age_s=age_s)
