"""What the control loop hands over to be kept, entry by entry, and where it hands it to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from tacauchy_rig.core.run import ArmSample, ForceSample, ImageFrame, JournalEvent, TrialRecord


@dataclass(frozen=True, slots=True)
class Begin:
    """An attempt begins."""

    trial: int
    attempt: int


@dataclass(frozen=True, slots=True)
class Force:
    """Force samples."""

    samples: tuple[ForceSample, ...]


@dataclass(frozen=True, slots=True)
class Arm:
    """Arm states."""

    samples: tuple[ArmSample, ...]


@dataclass(frozen=True, slots=True)
class End:
    """An attempt ended; frames up to ``stamp_ns`` belong to it."""

    record: TrialRecord
    stamp_ns: int


Entry = Begin | Force | Arm | ImageFrame | JournalEvent | End


class Sink(Protocol):
    """Takes the record of a run, in order; it never blocks and never loses in silence."""

    def put(self, entry: Entry) -> None:
        """Take an entry."""
        ...

    def problem(self) -> str:
        """Return why nothing more can be kept, or an empty text."""
        ...

    def lag_s(self) -> float:
        """Return for how long the oldest entry has been on its way to the disk [s]."""
        ...
