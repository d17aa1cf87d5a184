"""What the processes of a run send one another, and the channels it goes through."""

from __future__ import annotations

import pickle
import select
import socket
import struct
from dataclasses import dataclass, field
from enum import Enum, auto
from pathlib import Path
from typing import Any, Self

from drivers.interfaces import DeviceIdentity, FrameMark, StreamHealth
from protocols.trials.trial import PlannedTrial
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.errors import RigError
from tacauchy_rig.core.expected_press import ExpectedPress


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactOutline:
    """Where the indenter's contact should be seen in the camera's image.

    Attributes:
        image_size_px: Width and height of the camera's frames.
        centre_px: Where the indenter comes down, from the left and from the top.
        scale_px_m: Pixels to a metre, along and across.
        flat_radius_m: Of a flat face; 0 for a ball.
        ball_radius_m: Of a ball; 0 for a flat face.
    """

    image_size_px: tuple[int, int]
    centre_px: tuple[float, float]
    scale_px_m: tuple[float, float]
    flat_radius_m: float = 0.0
    ball_radius_m: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PageOptions:
    """The operator's page.

    Attributes:
        port: Of the loopback address; 0 takes a free one.
        outline: Expected contact in the image; None where nobody knows.
    """

    port: int = 0
    outline: ContactOutline | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewerOptions:
    """A viewer from outside of ``protocols``; the page shows what it shows.

    Attributes:
        name: One of ``feed.VIEWERS``.
        module: What its process runs, by ``python -m``.
        options: For its process.
        sources: Other viewers whose feeds it gets, where they run too.
    """

    name: str
    module: str
    options: dict[str, str] = field(default_factory=dict)
    sources: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """What a child is to do: its first message from the supervisor.

    Attributes:
        descriptors: Sockets that the child inherited, by what they lead to.
        expected: What a press should give; None where nobody knows.
        page: Of the operator's page; None for every other process.
        again: Whether an earlier process had begun it in this session.
        options: Of a viewer; the page's ``token`` is the first part of every path: whoever has it
            sees the run and can stop it.
    """

    root: Path
    config: RigConfig
    plan: tuple[PlannedTrial, ...]
    descriptors: dict[str, int]
    expected: ExpectedPress | None = None
    page: PageOptions | None = None
    again: bool = False
    options: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ready:
    """A child has connected its devices."""

    devices: dict[str, DeviceIdentity]


@dataclass(frozen=True, slots=True, kw_only=True)
class Failed:
    """A child cannot go on."""

    message: str
    remedy: str
    exit_code: int = 2

    @classmethod
    def because(cls, error: RigError) -> Failed:
        """Return what to tell of ``error``."""
        return cls(message=error.message, remedy=error.remedy, exit_code=error.exit_code)


class Order(Enum):
    """What the supervisor tells its children: begin, finish what is begun and end, or "I live"."""

    GO = auto()
    STOP = auto()
    ALIVE = auto()


@dataclass(frozen=True, slots=True, kw_only=True)
class AbortRequest:
    """A person wants the arm to stop."""

    reason: str


@dataclass(frozen=True, slots=True)
class Kept:
    """How many samples, frames and events of this producer the recorder has acknowledged."""

    count: int


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraStatus:
    """What the camera process tells control: marks of new frames, and how the stream does."""

    marks: tuple[FrameMark, ...]
    health: StreamHealth


@dataclass(frozen=True, slots=True, kw_only=True)
class Ack:
    """The recorder has everything up to entry ``through`` on disk.

    Attributes:
        kept_count: Samples, frames and events of this producer that are in recordings.
    """

    through: int
    kept_count: int


LARGEST = 1 << 18
HEADER = struct.Struct("!IQ")


class Channel:
    """One end of a pair of sockets that keep messages apart (SOCK_SEQPACKET).

    Safe to send from several threads and from a signal handler.

    Attributes:
        closed: True once the other end is gone and all that it sent has been received.
    """

    def __init__(self, end: socket.socket) -> None:
        end.setblocking(False)
        self._end = end
        self.closed = False

    @classmethod
    def pair(cls) -> tuple[Self, Self]:
        """Return two connected ends."""
        one, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        return cls(one), cls(other)

    @classmethod
    def inherited(cls, descriptor: int) -> Self:
        """Return the end that the parent process left open for this one."""
        return cls(socket.socket(fileno=descriptor))

    def fileno(self) -> int:
        """Return the descriptor, to hand it to a child or to wait on it."""
        return self._end.fileno()

    def send(self, message: Any) -> bool:
        """Send a message; return False where the other end is gone or reads too slowly."""
        try:
            self._end.send(pickle.dumps(message))
        except OSError:
            return False
        return True

    def receive(self, *, limit: int | None = None) -> list[Any]:
        """Return the messages that wait, oldest first, at most ``limit`` of them."""
        messages: list[Any] = []
        while not self.closed and (limit is None or len(messages) < limit):
            try:
                data = self._end.recv(LARGEST)
            except BlockingIOError:
                break
            except OSError:
                data = b""
            if not data:
                self.closed = True
                break
            messages.append(pickle.loads(data))  # noqa: S301 - from our own parent or child
        return messages

    def wait(self, timeout_s: float) -> bool:
        """Wait until a message waits or the other end is gone; False after ``timeout_s``."""
        if self.closed:
            return True
        return bool(select.select([self._end], [], [], max(timeout_s, 0.0))[0])

    def close(self) -> None:
        """Close this end."""
        self.closed = True
        self._end.close()


def pack_entry(number: int, entry: object) -> bytes:
    """Return an entry with its number, ready for a stream."""
    body = pickle.dumps(entry, protocol=pickle.HIGHEST_PROTOCOL)
    return HEADER.pack(len(body), number) + body


class EntryReader:
    """Puts entries together again from whatever pieces a stream delivers."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[tuple[int, Any]]:
        """Return (number, entry) of each entry that is complete now."""
        self._buffer += data
        entries: list[tuple[int, Any]] = []
        offset = 0
        while len(self._buffer) - offset >= HEADER.size:
            size, number = HEADER.unpack_from(self._buffer, offset)
            start = offset + HEADER.size
            if len(self._buffer) < start + size:
                break
            body = self._buffer[start : start + size]
            entries.append((number, pickle.loads(body)))  # noqa: S301 - from our own producers
            offset = start + size
        del self._buffer[:offset]
        return entries
