"""Where the control loop puts what it saw: never blocks, never loses in silence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from tacauchy_rig.run import ArmSample, ForceSample, JournalEvent, TrialRecord


class Sink(Protocol):
    """Takes the record of a run, in order."""

    def begin_attempt(self, trial: int, attempt: int) -> None:
        """Start the recording of an attempt."""
        ...

    def force(self, samples: Sequence[ForceSample]) -> None:
        """Take force samples, oldest first."""
        ...

    def arm(self, samples: Sequence[ArmSample]) -> None:
        """Take arm states, oldest first."""
        ...

    def event(self, event: JournalEvent) -> None:
        """Take a line of the journal."""
        ...

    def end_attempt(self, record: TrialRecord) -> None:
        """Finish the recording and keep its result."""
        ...

    def problem(self) -> str:
        """Return why nothing more can be kept, or an empty text."""
        ...

    def lag_s(self) -> float:
        """Return for how long the oldest entry has been on its way to the disk [s]."""
        ...
