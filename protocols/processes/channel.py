"""Small messages between two processes: whole or not at all, and never blocking."""

from __future__ import annotations

import pickle
import select
import socket
from typing import Any, Self

LARGEST = 1 << 18


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
