"""Writes what a run hands over, and the results of attempts that were cut off."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

from protocols.control.record import Arm, Begin, End, Entry, Force
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import ImageFrame, JournalEvent, Outcome, TrialRecord
from tacauchy_rig.core.store.journal import append_event, read_journal
from tacauchy_rig.core.store.recording.messages import Recorded
from tacauchy_rig.core.store.recording.writing import RecordingWriter
from tacauchy_rig.core.store.run_store import RunStore

logger = logging.getLogger(__name__)


class RecordKeeper:
    """Keeps the record of one run, on disk when ``keep`` returns.

    Streams that arrive between attempts are not kept. With ``spill_source`` it keeps what the
    recorder never acknowledged: beside the recording instead of in it, and only such lines of
    the journal as are not there yet.

    Args:
        store: The run's folder.
        spill_source: Process whose messages these are; empty in the recorder itself.

    Attributes:
        kept_count: Samples, frames and events written to recordings.
    """

    def __init__(self, store: RunStore, *, spill_source: str = "") -> None:
        self._store = store
        self._spill_source = spill_source
        self._writer: RecordingWriter | None = None
        self.kept_count = 0

    def keep(self, entry: Entry) -> None:
        """Write an entry.

        Raises:
            RecordError: The recording exists already, or the disk is full or gone.
        """
        match entry:
            case Begin(trial=trial, attempt=attempt):
                self._open(trial, attempt)
            case End(record=record):
                self._end(record)
            case JournalEvent():
                if not (self._spill_source and _is_journalled(self._store, entry)):
                    append_event(self._store.paths.journal, entry)
                self._write([entry])
            case Force(samples=samples) | Arm(samples=samples):
                self._write(samples)
            case ImageFrame():
                self._write([entry])

    def _write(self, items: Sequence[Recorded]) -> None:
        if self._writer is not None:
            self._writer.write(items)
            self.kept_count += len(items)

    def _open(self, trial: int, attempt: int) -> None:
        self.close()
        paths = self._store.paths
        source = self._spill_source
        path = paths.spill(trial, attempt, source) if source else paths.recording(trial, attempt)
        metadata = {
            "run": paths.root.name,
            "trial": str(trial),
            "attempt": str(attempt),
            "config_hash": self._store.config_hash,
            "source": source or "recorder",
        }
        self._writer = RecordingWriter(path, metadata=metadata)

    def _end(self, record: TrialRecord) -> None:
        """Finish the recording and keep the result with its hash; the result in any case."""
        recording_sha256 = None
        try:
            recording_sha256 = self.close()
        finally:
            if self._spill_source:  # which is a part of the recording only
                recording_sha256 = None
            self._store.save_result(replace(record, recording_sha256=recording_sha256))

    def close(self) -> str | None:
        """Finish the recording that is open and return its SHA-256; None where it is cut short.

        Raises:
            RecordError: The disk is full or gone.
        """
        if self._writer is None:
            return None
        writer, self._writer = self._writer, None
        writer.close()
        return writer.sha256


def _is_journalled(store: RunStore, event: JournalEvent) -> bool:
    try:
        known = read_journal(store.paths.journal)
    except RecordError:
        return False
    return any(line.stamp_ns == event.stamp_ns and line.name == event.name for line in known)


def complete_results(store: RunStore, begun: Sequence[JournalEvent], *, reason: str) -> None:
    """Mark each attempt that has no result as a fault, for ``reason``, and seal the others.

    Args:
        store: The run's folder.
        begun: The ``attempt-start`` events of this session.
        reason: What cut the attempt off.
    """
    for event in begun:
        record = store.load_result(event.trial, event.attempt) or TrialRecord(
            index=event.trial,
            attempt=event.attempt,
            outcome=Outcome.FAULT,
            force_target_n=float(event.detail["force_target_n"]),
            reason=reason,
        )
        try:
            store.save_result(record)
        except RecordError as error:
            logger.error("%s", error)


def last_results(store: RunStore, begun: Sequence[JournalEvent]) -> tuple[TrialRecord, ...]:
    """Return the result of the last attempt at each trial that was begun."""
    last = {event.trial: event.attempt for event in begun}
    loaded = (store.load_result(trial, attempt) for trial, attempt in last.items())
    return tuple(record for record in loaded if record is not None)
