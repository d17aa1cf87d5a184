"""Between two processes: small messages, whole and never blocking, and entries of the record."""

from __future__ import annotations

import pickle
import select
import socket
import struct
from typing import Any, Self

from protocols.control.record import Entry

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


def encode(number: int, entry: Entry) -> bytes:
    """Return an entry with its number, ready for a stream."""
    body = pickle.dumps(entry, protocol=pickle.HIGHEST_PROTOCOL)
    return HEADER.pack(len(body), number) + body


class EntryReader:
    """Puts entries together again from whatever pieces a stream delivers."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[tuple[int, Entry]]:
        """Return (number, entry) of each entry that is complete now."""
        self._buffer += data
        entries: list[tuple[int, Entry]] = []
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
