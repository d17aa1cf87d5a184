"""What the control loop hands over to be kept, entry by entry, and where it hands it to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from drivers.interfaces import Clock
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import (
    ArmSample,
    ForceSample,
    ImageFrame,
    JournalEvent,
    Phase,
    TrialRecord,
)


@dataclass(frozen=True, slots=True)
class Begin:
    """An attempt begins."""

    trial: int
    attempt: int


@dataclass(frozen=True, slots=True)
class End:
    """An attempt ended; frames up to ``stamp_ns`` belong to it."""

    record: TrialRecord
    stamp_ns: int


Samples = tuple[ForceSample | ArmSample | ImageFrame, ...]
Entry = Begin | Samples | JournalEvent | End
"""What a producer records; samples of one entry are of one kind."""


class Sink(Protocol):
    """Takes the record of a run, in order; it never blocks and never loses in silence."""

    def put(self, entry: Entry) -> None:
        """Take an entry."""

    def problem(self) -> str:
        """Return why nothing more can be kept, or an empty text."""

    def lag_s(self) -> float:
        """Return for how long the oldest entry has been on its way to the disk [s]."""


PROGRESS = "progress"
"""Name of events that are shown and not kept."""


class Journal:
    """Writes events of the attempt that runs now; between trials its number is 0."""

    def __init__(
        self, sink: Sink, clock: Clock, *, listener: Callable[[JournalEvent], object]
    ) -> None:
        self.trial = 0
        self.attempt = 0
        self.phase = Phase.PREFLIGHT
        self._sink = sink
        self._clock = clock
        self._listener = listener

    def enter(self, phase: Phase, **detail: Any) -> None:
        """Note that a phase begins; units in the names of ``detail``."""
        self.phase = phase
        self.write("phase", phase=phase.value, **detail)

    def write(self, name: str, **detail: Any) -> None:
        """Keep and show an event. A record that is gone is the cycle's matter, not raised here."""
        event = self._event(name, detail)
        try:
            self._sink.put(event)
        except RecordError as error:
            event.detail["not_recorded"] = error.message
        self._listener(event)

    def show(self, **detail: Any) -> None:
        """Show progress without keeping it."""
        self._listener(self._event(PROGRESS, {"phase": self.phase.value, **detail}))

    def _event(self, name: str, detail: dict[str, Any]) -> JournalEvent:
        return JournalEvent(
            stamp_ns=self._clock.now_ns(),
            name=name,
            trial=self.trial,
            attempt=self.attempt,
            detail=detail,
        )
