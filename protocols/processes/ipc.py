"""What the processes of a run send one another, and the channels it goes through."""

import os
import pickle
import select
import socket
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from itertools import islice
from pathlib import Path
from typing import Any, Self

from drivers.interfaces import DeviceIdentity, FrameMark, StreamHealth
from protocols.trials.trial_sequence import PlannedTrial
from tacauchy_rig.core.config.settings import RigConfig
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
            except ConnectionResetError:
                continue  # said once, where the other end left ours unread; its own still wait
            except OSError:
                data = b""
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


VIEWERS = ("page", "twin", "foxglove")
"""Processes that may watch a run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """Something that a viewer is shown."""

    stream: str  # its name, such as ``force``, ``arm``, ``camera``, ``twin``
    stamp_ns: int  # ``time.monotonic_ns`` of what it tells of
    numbers: dict[str, Any]  # plain values, lists and texts; units in the keys
    picture: bytes | None = None  # bytes of a JPEG or PNG; None where there is none


class FeedWriters:
    """A producer's ends to those of ``viewers`` that run; ``show`` neither blocks nor raises."""

    def __init__(self, descriptors: Mapping[str, int], viewers: Iterable[str]) -> None:
        self._channels = _inherited(descriptors, viewers)
        self._number = 0

    def __bool__(self) -> bool:
        return bool(self._channels)

    def show(
        self, stream: str, stamp_ns: int, numbers: dict[str, Any], picture: bytes | None = None
    ) -> None:
        """Show something to each viewer; one that is too slow or gone misses it."""
        self._number += 1
        shown = Shown(stream=stream, stamp_ns=stamp_ns, numbers=numbers)
        message = self._number, shown, picture is not None
        if picture is None:
            self._send(message)
            return
        try:
            with os.fdopen(os.memfd_create("picture"), "wb", buffering=0) as file:
                file.write(picture)
                self._send(message, file.fileno())
        except OSError:  # no memory for it
            self._send(message)

    def _send(self, message: tuple[int, Shown, bool], file: int | None = None) -> None:
        for channel in self._channels:
            channel.send(message, file=file)


class FeedReader:
    """A viewer's end."""

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self.fileno = channel.fileno
        self._number: int | None = None
        self.lost_count = 0  # messages and pictures that this viewer was too slow for

    def receive(self) -> Iterator[Shown]:
        """Yield what waits, oldest first."""
        for (number, shown, has_picture), files in self._channel.receive_with_files():
            if self._number is not None:
                self.lost_count += number - self._number - 1
            self._number = number
            self.lost_count += has_picture and not files
            for file in files:
                # Other viewers share the file and its position.
                shown = replace(shown, picture=os.pread(file, os.fstat(file).st_size, 0))
                os.close(file)
            yield shown


def feed_readers(descriptors: Mapping[str, int], sources: Iterable[str]) -> list[FeedReader]:
    """Return the ends that the parent process left open, of those of ``sources`` that run."""
    return [FeedReader(channel) for channel in _inherited(descriptors, sources)]


def _inherited(descriptors: Mapping[str, int], others: Iterable[str]) -> list[Channel]:
    ends = (descriptors.get(f"{other}-feed") for other in others)
    return [Channel.inherited(end) for end in ends if end is not None]


class FeedLines:
    """Feeds between processes, kept open by the supervisor so that a viewer can be started anew.

    Args:
        pairs: (producer, viewer) by their names.
    """

    def __init__(self, pairs: Iterable[tuple[str, str]]) -> None:
        self._ends: dict[str, dict[str, Channel]] = {}
        for producer, viewer in pairs:
            theirs, ours = Channel.pair()
            self._ends.setdefault(producer, {})[f"{viewer}-feed"] = theirs
            self._ends.setdefault(viewer, {})[f"{producer}-feed"] = ours

    def descriptors(self, name: str) -> dict[str, int]:
        """Return what a process has to inherit, by what it leads to."""
        return {what: end.fileno() for what, end in self._ends.get(name, {}).items()}

    def close(self) -> None:
        """Close every end here."""
        for ends in self._ends.values():
            for end in ends.values():
                end.close()
