"""One client of an emulated controller: a socket that never blocks, with an optional delay."""

from __future__ import annotations

import socket
import struct
from collections import deque

_BACKLOG_LIMIT = 1 << 20
_RECEIVE_SIZE = 65536
_RESET_ON_CLOSE = struct.pack("ii", 1, 0)


class Connection:
    """A connected client.

    Attributes:
        alive: False once the client is gone; the owner then drops it.
        delay_s: Added to both directions [s], to imitate a slow network.
    """

    def __init__(self, link: socket.socket) -> None:
        link.setblocking(False)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.socket = link
        self.alive = True
        self.delay_s = 0.0
        self._unsent = bytearray()
        self._late_out: deque[tuple[float, bytes]] = deque()
        self._late_in: deque[tuple[float, bytes]] = deque()

    @property
    def is_congested(self) -> bool:
        """True while earlier data wait for the client to read; newer states may be left out."""
        return bool(self._unsent)

    def receive(self, now_s: float) -> bytes:
        """Return what has arrived and is due."""
        chunks: list[bytes] = []
        while self.alive:
            try:
                data = self.socket.recv(_RECEIVE_SIZE)
            except BlockingIOError:
                break
            except OSError:
                self.alive = False
                break
            if not data:
                self.alive = False
            elif self.delay_s > 0.0 or self._late_in:
                self._late_in.append((now_s + self.delay_s, data))
            else:
                chunks.append(data)
        while self._late_in and self._late_in[0][0] <= now_s:
            chunks.append(self._late_in.popleft()[1])
        return b"".join(chunks)

    def send(self, data: bytes, now_s: float) -> None:
        """Send ``data``, or keep it until it is due or the client reads."""
        if self.delay_s > 0.0 or self._late_out:
            self._late_out.append((now_s + self.delay_s, data))
        else:
            self._push(data)

    def service(self, now_s: float) -> None:
        """Send what has become due."""
        while self._late_out and self._late_out[0][0] <= now_s:
            self._push(self._late_out.popleft()[1])
        if self._unsent:
            self._push(b"")

    def close(self, *, reset: bool = False) -> None:
        """Close; with ``reset`` the client sees a broken connection instead of an orderly end."""
        if reset:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET_ON_CLOSE)
        self.alive = False
        self.socket.close()

    def _push(self, data: bytes) -> None:
        if not self.alive:
            return
        if self._unsent:
            self._unsent += data
            data = bytes(self._unsent)
            self._unsent.clear()
        try:
            sent = self.socket.send(data)
        except BlockingIOError:
            sent = 0
        except OSError:
            self.alive = False
            return
        if sent < len(data):
            self._unsent += data[sent:]
            self.alive = len(self._unsent) < _BACKLOG_LIMIT


class Port:
    """A listening socket and its clients."""

    def __init__(self, host: str, number: int) -> None:
        self.number = number
        self._delay_s = 0.0
        self.connections: list[Connection] = []
        self._address = (host, number)
        self._listener: socket.socket | None = None
        self.open()

    def open(self) -> None:
        """Listen."""
        if self._listener is None:
            listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind(self._address)
            listener.listen(8)
            listener.setblocking(False)
            self._listener = listener

    def delay(self, delay_s: float) -> None:
        """Delay both directions of every connection, those to come included, by ``delay_s`` [s]."""
        self._delay_s = delay_s
        for connection in self.connections:
            connection.delay_s = delay_s

    def drop(self) -> None:
        """Break every connection and refuse new ones until ``open``."""
        for connection in self.connections:
            connection.close(reset=True)
        if self._listener is not None:
            self._listener.close()
            self._listener = None

    def sockets(self) -> list[socket.socket]:
        """Return what an event loop has to watch."""
        listening = [self._listener] if self._listener is not None else []
        return listening + [c.socket for c in self.connections if c.alive]

    def accept(self) -> list[Connection]:
        """Return the clients that connected since the last call."""
        fresh: list[Connection] = []
        while self._listener is not None:
            try:
                link, _ = self._listener.accept()
            except OSError:
                break
            connection = Connection(link)
            connection.delay_s = self._delay_s
            fresh.append(connection)
        self.connections += fresh
        return fresh

    def reap(self) -> list[Connection]:
        """Close and return the clients that are gone."""
        gone = [connection for connection in self.connections if not connection.alive]
        if gone:
            self.connections = [c for c in self.connections if c.alive]
            for connection in gone:
                connection.close()
        return gone
