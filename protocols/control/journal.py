"""What happened, line by line: to the record, and to whoever watches."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from drivers.device.interface import Clock
from protocols.control.record import Sink
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import JournalEvent, Phase

PROGRESS = "progress"
"""Name of events that are shown and not kept."""


class Journal:
    """Writes events of the attempt that runs now.

    Attributes:
        trial: Trial that runs now; 0 between trials.
        attempt: Its attempt; 0 between trials.
        phase: Where it is.
    """

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
