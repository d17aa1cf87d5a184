"""What the processes of a run send one another, and the channels it goes through."""

from __future__ import annotations

import pickle
import select
import socket
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum, auto
from itertools import islice
from pathlib import Path
from typing import Any, Self

from drivers.interfaces import DeviceIdentity, FrameMark, StreamHealth
from protocols.trials.trial import PlannedTrial
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.run import ExpectedPress


@dataclass(frozen=True, slots=True, kw_only=True)
class PageOptions:
    """The operator's page."""

    port: int = 0  # of the loopback address; 0 takes a free one
    # Expected contact in the image, as the page draws it; None where nobody knows.
    outline: dict[str, Any] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewerOptions:
    """A viewer from outside of ``protocols``; the page shows what it shows."""

    name: str  # one of ``feed.VIEWERS``
    module: str  # what its process runs, by ``python -m``
    options: dict[str, Any] = field(default_factory=dict)  # for its process
    sources: tuple[str, ...] = ()  # other viewers whose feeds it gets, where they run too


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """What a child is to do: its first message from the supervisor."""

    root: Path
    config: RigConfig
    plan: tuple[PlannedTrial, ...]
    descriptors: dict[str, int]  # sockets that the child inherited, by what they lead to
    expected: ExpectedPress | None = None  # what a press should give; None where nobody knows
    again: bool = False  # whether an earlier process had begun it in this session
    # Of a viewer; the page's ``token`` is the first part of every path: whoever has it sees the run
    # and can stop it.
    options: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ready:
    """A child has connected its devices."""

    devices: dict[str, DeviceIdentity]


class Order(Enum):
    """What the supervisor tells its children: begin, finish what is begun and end, or "I live"."""

    GO = auto()
    STOP = auto()
    ALIVE = auto()


@dataclass(frozen=True, slots=True, kw_only=True)
class AbortRequest:
    """A person wants the arm to stop."""

    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraStatus:
    """What the camera process tells control: marks of new frames, and how the stream does."""

    marks: tuple[FrameMark, ...]
    health: StreamHealth


@dataclass(frozen=True, slots=True, kw_only=True)
class Ack:
    """The recorder has everything up to entry ``through`` on disk; its producer passes that on."""

    through: int = 0
    kept_count: int = 0  # samples, frames and events of this producer that are in recordings


LARGEST = 1 << 18


class Channel:
    """One end of a pair of sockets that keep messages apart (SOCK_SEQPACKET).

    Safe to send from several threads and from a signal handler. A ``RigError`` among the messages
    says that its sender cannot go on.
    """

    def __init__(self, end: socket.socket) -> None:
        end.setblocking(False)
        self._end = end
        # True once the other end is gone and all that it sent has been received.
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

    def send(self, message: Any, *, file: int | None = None) -> bool:
        """Send a message, with an open file; return False where nobody takes it now."""
        try:
            files = [] if file is None else [file]
            socket.send_fds(self._end, [pickle.dumps(message)], files)
        except OSError:
            return False
        return True

    def receive(self, *, limit: int | None = None) -> list[Any]:
        """Return the messages that wait, oldest first, at most ``limit`` of them."""
        return [message for message, _ in islice(self.receive_with_files(), limit)]

    def receive_with_files(self) -> Iterator[tuple[Any, list[int]]]:
        """Yield the messages that wait, each with the descriptor of its file, for you to close."""
        while not self.closed:
            try:
                data, files, _, _ = socket.recv_fds(self._end, LARGEST, 1)
            except BlockingIOError:
                return
            except OSError:
                data, files = b"", []
            if not data:
                self.closed = True
                return
            yield pickle.loads(data), files  # noqa: S301 - from our own parent or child

    def wait(self, timeout_s: float) -> bool:
        """Wait until a message waits or the other end is gone; False after ``timeout_s``."""
        if self.closed:
            return True
        return bool(select.select([self._end], [], [], max(timeout_s, 0.0))[0])

    def close(self) -> None:
        """Close this end."""
        self.closed = True
        self._end.close()
