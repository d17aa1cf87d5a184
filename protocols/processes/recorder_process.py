"""The recorder process, a producer's way to it, and control's view of the camera process.

The recorder takes entries from its producers, writes them, and acknowledges them.
"""

import logging
import math
import pickle
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from drivers.interfaces import FrameMark, StreamHealth, TouchMode
from protocols.control.cycle import Begin, End, Entry
from protocols.processes.child_process import ask_for_priority, ignore_signals, run_child
from protocols.processes.ipc import Ack, CameraStatus, Channel, Job, Ready
from tacauchy_rig.core.errors import DeviceError, RecordError, RigError
from tacauchy_rig.core.run import JournalEvent, TrialRecord
from tacauchy_rig.core.store.journal import Journal, append_event
from tacauchy_rig.core.store.recording.mcap_writer import RawMessage, RecordingWriter, Topic, encode
from tacauchy_rig.core.store.run_store import RunStore

logger = logging.getLogger(__name__)

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
        known = Journal.read(store.paths.journal).events
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


STALLED_S = 3.0
WAITING_BYTES_MAX = 256 << 20


BETWEEN_ATTEMPTS = Begin(0, 0)


@dataclass(frozen=True, slots=True)
class _Waiting:
    number: int
    entry: Encoded
    attempt: Begin
    size: int
    since_s: float


class RecorderLink:
    """One producer's end, a ``Sink``; ``put`` never blocks.

    Args:
        descriptors: Of the stream to the recorder, and of the channel on which it answers.
        store: Where to spill what it does not acknowledge.
        on_attempt: Told when another attempt begins, and of ``BETWEEN_ATTEMPTS`` at its end.
    """

    def __init__(
        self,
        descriptors: Mapping[str, int],
        *,
        store: RunStore,
        source: str,
        on_attempt: Callable[[Begin], object] = lambda _: None,
    ) -> None:
        self.kept = Ack()  # what the recorder acknowledged last
        self.attempt = BETWEEN_ATTEMPTS  # what the entries that are put now belong to
        self._on_attempt = on_attempt
        self._data = socket.socket(fileno=descriptors["recorder-data"])
        self._acks = Channel.inherited(descriptors["recorder-acks"])
        self._store = store
        self._source = source
        self._number = self._sent_number = 0  # of the newest entry, and of the newest sent
        self._waiting: deque[_Waiting] = deque()  # what is not acknowledged
        self._changed = threading.Condition()
        self._problem = ""
        self._spilling = False
        self._closing = False
        self._thread = threading.Thread(target=self._deliver, name="recorder-link", daemon=True)
        self._thread.start()

    def put(self, entry: Entry) -> None:
        """Queue an entry."""
        kept = encoded(entry)
        size = sum(len(message.data) for message in kept) if isinstance(kept, tuple) else 1000
        if isinstance(entry, Begin):
            self._enter(entry)
        with self._changed:
            self._number += 1
            since_s = time.monotonic()
            self._waiting.append(_Waiting(self._number, kept, self.attempt, size, since_s))
            self._changed.notify_all()
        if isinstance(entry, End):
            self._enter(BETWEEN_ATTEMPTS)

    def _enter(self, attempt: Begin) -> None:
        self.attempt = attempt
        self._on_attempt(attempt)

    def poll(self) -> None:
        """Take the recorder's answers; call it often."""
        for message in self._acks.receive():
            if isinstance(message, Ack):
                with self._changed:
                    self.kept = message
                    while self._waiting and self._waiting[0].number <= message.through:
                        self._waiting.popleft()
            elif isinstance(message, RigError):
                self._note(f"recorder: {message.message}")
        if self._acks.closed and not self._closing:
            self._note("recorder: its process is gone")

    def problem(self) -> str:
        """Return why nothing more can be recorded properly, or an empty text."""
        self.poll()
        lag_s = self.lag_s()
        if lag_s > STALLED_S and not self._spilling:
            self._note(f"recorder: it has acknowledged nothing for {lag_s:.1f} s")
        with self._changed:
            size = sum(each.size for each in self._waiting)
        if size > WAITING_BYTES_MAX:
            self._note(f"recorder: {size >> 20} MB wait for the disk")
        return self._problem

    def lag_s(self) -> float:
        """Return how long the oldest entry has been waiting [s]."""
        with self._changed:
            return time.monotonic() - self._waiting[0].since_s if self._waiting else 0.0

    def close(self, *, timeout_s: float) -> None:
        """Wait for the last acknowledgement, or spill; return within about ``timeout_s`` [s]."""
        deadline = time.monotonic() + timeout_s
        while self._waiting and time.monotonic() < deadline - timeout_s / 2:
            self.poll()
            if self._problem:
                break
            self._acks.wait(0.02)
        with self._changed:
            self._closing = True
            complete = not self._waiting
            self._changed.notify_all()
        try:
            self._data.shutdown(socket.SHUT_WR if complete else socket.SHUT_RDWR)
        except OSError:
            logger.debug("%s: the recorder's end is closed already", self._source)
        self._thread.join(max(deadline - time.monotonic(), 0.1))
        self._data.close()
        self._acks.close()

    def _note(self, problem: str) -> None:
        if not self._problem:
            self._problem = problem
            logger.error("%s: %s", self._source, problem)
            with self._changed:
                self._changed.notify_all()

    def _deliver(self) -> None:
        while (waiting := self._next_unsent()) is not None:
            try:
                self._data.sendall(pickle.dumps((waiting.number, waiting.entry)))
            except OSError as error:
                self._note(f"recorder: its process is gone ({error.strerror or error})")
                break
        if self._waiting:
            self._spill()

    def _next_unsent(self) -> _Waiting | None:
        """Return the next entry to send; None when the link is broken or all is sent."""
        with self._changed:
            while self._sent_number == self._number and not self._closing and not self._problem:
                self._changed.wait(0.1)
            if self._problem or self._sent_number == self._number:
                return None
            self._sent_number += 1
            return self._waiting[self._sent_number - self._waiting[0].number]

    def _spill(self) -> None:
        """Keep what waits beside the recording of the attempt that it belongs to."""
        self._spilling = True
        keeper = RecordKeeper(self._store, spill_source=self._source)
        attempt = BETWEEN_ATTEMPTS
        try:
            while (waiting := self._next_waiting()) is not None:
                if waiting.attempt != attempt:
                    attempt = waiting.attempt
                    keeper.keep(attempt) if attempt != BETWEEN_ATTEMPTS else keeper.close()
                if not isinstance(waiting.entry, Begin):
                    keeper.keep(waiting.entry)
            keeper.close()
        except RecordError as error:
            logger.error("%s: %d entries are lost: %s", self._source, len(self._waiting), error)
            self._problem = f"{self._problem}; {error.message}"

    def _next_waiting(self) -> _Waiting | None:
        with self._changed:
            while not self._waiting and not self._closing:
                self._changed.wait(0.1)
            return self._waiting.popleft() if self._waiting else None


class RemoteCamera:
    """Watches the camera process by its status messages; see ``CameraMonitor``."""

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._health = StreamHealth()
        self._newest_ns: int | None = None
        self._requests: deque[TouchMode | Begin] = deque()

    def poll(self) -> list[FrameMark]:
        """Return the marks that arrived.

        Raises:
            DeviceError: The camera is gone, or its process is.
        """
        self._send_requests()
        marks: list[FrameMark] = []
        for message in self._channel.receive():
            if isinstance(message, DeviceError):
                raise message
            if isinstance(message, CameraStatus):
                marks += message.marks
                self._health = message.health
        self._newest_ns = marks[-1].stamp_ns if marks else self._newest_ns
        if self._channel.closed:
            raise DeviceError(
                "camera: its process is gone",
                remedy="read logs/camera.log in the run folder, then `tacauchy-rig resume`",
            )
        return marks

    def ask(self, request: TouchMode | Begin) -> None:
        """Tell the camera process what to look for, or which attempt its frames belong to."""
        self._requests.append(request)
        self._send_requests()

    def _send_requests(self) -> None:
        """Send what waits; what is not taken now goes with the next call."""
        while self._requests and self._channel.send(self._requests[0]):
            self._requests.popleft()

    def health(self) -> StreamHealth:
        """Return counts and rate as last reported, and the age as it is now."""
        newest_ns = self._newest_ns
        age_s = math.inf if newest_ns is None else (time.monotonic_ns() - newest_ns) * 1e-9
        return replace(self._health, age_s=age_s)


if __name__ == "__main__":
    sys.exit(run_child("recorder", record))
