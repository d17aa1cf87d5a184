"""A producer's way to the recorder, and control's view of the camera process."""

import logging
import math
import pickle
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from drivers.interfaces import FrameMark, StreamHealth, TouchMode
from protocols.control.record_entries_and_rates import Begin, End, Entry
from protocols.processes.ipc import Ack, CameraStatus, Channel
from protocols.processes.recorder_process import Encoded, RecordKeeper, encoded
from tacauchy_rig.core.errors import DeviceError, RecordError, RigError
from tacauchy_rig.core.store.run_store import RunStore

logger = logging.getLogger(__name__)

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
        self._number = 0
        self._waiting: deque[_Waiting] = deque()
        self._unsent: deque[_Waiting] = deque()
        self._waiting_bytes = 0
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
            waiting = _Waiting(self._number, kept, self.attempt, size, time.monotonic())
            self._waiting.append(waiting)
            self._unsent.append(waiting)
            self._waiting_bytes += size
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
                        self._waiting_bytes -= self._waiting.popleft().size
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
        if self._waiting_bytes > WAITING_BYTES_MAX:
            self._note(f"recorder: {self._waiting_bytes >> 20} MB wait for the disk")
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
            while not self._unsent and not self._closing and not self._problem:
                self._changed.wait(0.1)
            if self._problem or not self._unsent:
                return None
            return self._unsent.popleft()

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
            if not self._waiting:
                return None
            waiting = self._waiting.popleft()
            self._waiting_bytes -= waiting.size
            return waiting


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
