"""The recorder process: takes entries from its producers, writes them, and acknowledges them."""

import pickle
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import replace

from protocols.control.record_entries_and_rates import Begin, End, Entry
from protocols.processes.child_process import ask_for_priority, ignore_signals, run_child
from protocols.processes.ipc import Ack, Channel, Job, Ready
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import JournalEvent, TrialRecord
from tacauchy_rig.core.store.journal import append_event, read_journal
from tacauchy_rig.core.store.recording.mcap_writer import RawMessage, RecordingWriter, Topic, encode
from tacauchy_rig.core.store.run_store import RunStore

NICENESS = -5
LATE_FRAMES_S = 1.0


Encoded = Begin | tuple[RawMessage, ...] | JournalEvent | End
"""An entry on its way to the disk."""


def encoded(entry: Entry) -> Encoded:
    """Return an entry with its samples as the recording holds them."""
    return tuple(map(encode, entry)) if isinstance(entry, tuple) else entry


class RecordKeeper:
    """Keeps the record of one run, on disk when ``keep`` returns.

    Streams that arrive between attempts are not kept. With ``spill_source`` it keeps what the
    recorder never acknowledged: beside the recording instead of in it, and only such lines of
    the journal as are not there yet.
    """

    def __init__(self, store: RunStore, *, spill_source: str = "") -> None:
        self._store = store
        self._spill_source = spill_source
        self._writer: RecordingWriter | None = None
        self._attempt: Begin | None = None
        self.kept_count = 0  # samples, frames and events in recordings

    def keep(self, entry: Encoded) -> None:
        """Write an entry; samples come encoded and go into the recording as they are.

        Raises:
            RecordError: The recording exists already, or the disk is full or gone.
        """
        match entry:
            case Begin():
                self.close()
                self._attempt = entry
                if not self._spill_source:  # which is opened by its first message
                    self._writer = self._open(entry)
            case End(record=record):
                self._end(record)
            case JournalEvent():
                if not (self._spill_source and _is_journalled(self._store, entry)):
                    append_event(self._store.paths.journal, entry)
                self._write([encode(entry)])
            case _:
                self._write(entry)

    def _write(self, messages: Sequence[RawMessage]) -> None:
        if self._attempt is None:
            return
        self._writer = self._writer or self._open(self._attempt)
        self._writer.write_raw(messages)
        self.kept_count += len(messages)

    def _open(self, begun: Begin) -> RecordingWriter:
        paths, trial, attempt = self._store.paths, begun.trial, begun.attempt
        source = self._spill_source
        path = paths.spill(trial, attempt, source) if source else paths.recording(trial, attempt)
        metadata = {
            "run": paths.root.name,
            "trial": str(trial),
            "attempt": str(attempt),
            "config_hash": self._store.config_hash,
            "source": source or "recorder",
        }
        return RecordingWriter(path, metadata=metadata)

    def _end(self, record: TrialRecord) -> None:
        """Finish the recording and keep the result with its hash; the result in any case."""
        sha256 = None
        try:
            sha256 = self.close()
        finally:
            sha256 = None if self._spill_source else sha256  # a part of the recording only
            self._store.save_result(replace(record, recording_sha256=sha256))

    def close(self) -> str | None:
        """Finish the recording that is open and return its SHA-256; None where it is cut short."""
        self._attempt = None
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


class Producer:
    """One process that sends entries, numbered."""

    def __init__(self, name: str, data: socket.socket, acks: Channel) -> None:
        self.name = name
        self.acks = acks
        self.entries: deque[tuple[int, Encoded]] = deque()
        self.newest_frame_ns = 0
        self.ended = False
        self.kept = self.acknowledged = Ack()
        self._stream = data.makefile("rb")

    def read(self) -> bool:
        """Wait for the next entry and take it; return False at the end of the stream."""
        try:
            self.entries.append(pickle.load(self._stream))  # noqa: S301 - from our own producers
        except (EOFError, OSError, pickle.UnpicklingError):  # also in the middle of an entry
            self.ended = True
        return not self.ended


class Recorder:
    """Writes entries in each producer's order; an attempt ends when its last frames are in."""

    def __init__(self, keeper: RecordKeeper, producers: list[Producer]) -> None:
        self._keeper = keeper
        self._producers = producers
        self._held_until_s = 0.0
        self._arrived = threading.Event()

    def run(self) -> None:
        """Record until every producer has ended."""
        for producer in self._producers:
            threading.Thread(target=self._listen, args=(producer,), daemon=True).start()
        while not all(p.ended and not p.entries for p in self._producers):
            self._arrived.wait(0.05)
            self._arrived.clear()
            self.step()
        self._keeper.close()
        acknowledged = {p.name: p.acknowledged.kept_count for p in self._producers}
        self._keeper.keep(JournalEvent.now("record-end", acknowledged=acknowledged))

    def _listen(self, producer: Producer) -> None:
        while producer.read():
            self._arrived.set()

    def step(self) -> None:
        """Write what has arrived and acknowledge it."""
        for producer in self._producers:
            while producer.entries and not self._must_wait(producer.entries[0][1]):
                number, entry = producer.entries.popleft()
                self._keep(producer, number, entry)
        for producer in self._producers:
            if producer.kept == producer.acknowledged or producer.ended:
                continue
            if producer.acks.send(producer.kept):
                producer.acknowledged = producer.kept

    def _keep(self, producer: Producer, number: int, entry: Encoded) -> None:
        before = self._keeper.kept_count
        self._keeper.keep(entry)
        count = producer.kept.kept_count + self._keeper.kept_count - before
        producer.kept = Ack(through=number, kept_count=count)
        if isinstance(entry, tuple) and entry[-1].topic is Topic.IMAGE:
            producer.newest_frame_ns = entry[-1].log_time

    def _must_wait(self, entry: Encoded) -> bool:
        """Hold the end of an attempt back until the frames before it have come, for a while."""
        if not isinstance(entry, End):
            return False
        now_s = time.monotonic()
        cameras = [p for p in self._producers if p.newest_frame_ns and not p.ended]
        late = any(p.newest_frame_ns < entry.stamp_ns for p in cameras)
        self._held_until_s = self._held_until_s or now_s + LATE_FRAMES_S
        if late and now_s < self._held_until_s:
            return True
        self._held_until_s = 0.0
        return False


def record(job: Job, supervisor: Channel) -> None:
    """Do the recorder's job."""
    ignore_signals()
    ask_for_priority(NICENESS)
    store = RunStore.open(job.root)
    producers = [
        Producer(
            name,
            socket.socket(fileno=job.descriptors[f"{name}-data"]),
            Channel.inherited(job.descriptors[f"{name}-acks"]),
        )
        for name in ("control", "camera")
    ]
    supervisor.send(Ready(devices={}))
    try:
        Recorder(RecordKeeper(store), producers).run()
    except RecordError as error:
        for producer in producers:
            producer.acks.send(error)
        raise


if __name__ == "__main__":
    sys.exit(run_child("recorder", record))
