"""Recording without processes: for mocks, where nothing can be late."""

from __future__ import annotations

from collections.abc import Sequence

from drivers.interfaces import Camera, StreamHealth
from drivers.rig import FrameMark
from protocols.record_keeper import RecordKeeper
from tacauchy_rig.run import ArmSample, ForceSample, JournalEvent, TrialRecord


class DirectSink:
    """Hands everything to a record keeper at once; see ``Sink``."""

    def __init__(self, keeper: RecordKeeper) -> None:
        self._keeper = keeper

    def begin_attempt(self, trial: int, attempt: int) -> None:
        """Start the recording of an attempt."""
        self._keeper.begin_attempt(trial, attempt)

    def force(self, samples: Sequence[ForceSample]) -> None:
        """Record force samples."""
        self._keeper.force(samples)

    def arm(self, samples: Sequence[ArmSample]) -> None:
        """Record arm states."""
        self._keeper.arm(samples)

    def event(self, event: JournalEvent) -> None:
        """Record a line of the journal."""
        self._keeper.event(event)

    def end_attempt(self, record: TrialRecord) -> None:
        """Keep the result."""
        self._keeper.end_attempt(record)

    def problem(self) -> str:
        """Return nothing: problems are raised where they happen."""
        return ""

    def lag_s(self) -> float:
        """Return zero: each call returns with its data on disk."""
        return 0.0


class DirectCamera:
    """A camera in this process, watched and recorded at once; see ``CameraMonitor``."""

    def __init__(self, camera: Camera, keeper: RecordKeeper) -> None:
        self._camera = camera
        self._keeper = keeper

    def poll(self) -> list[FrameMark]:
        """Record the frames that arrived and return their marks."""
        frames = self._camera.drain()
        for frame in frames:
            self._keeper.frame(frame)
        return [FrameMark(frame.stamp_ns, frame.counter) for frame in frames]

    def health(self) -> StreamHealth:
        """Return counts, age and rate."""
        return self._camera.health()
