"""Serves JPEG frames as HTTP multipart, the way network cameras do."""

from __future__ import annotations

import contextlib
import logging
import socket
import threading
from collections import deque

_BOUNDARY = "frame"
_BACKLOG = 4  # frames that wait for a slow reader before the oldest is lost
_HEADER = (
    "HTTP/1.0 200 OK\r\nCache-Control: no-store\r\nConnection: close\r\n"
    f"Content-Type: multipart/x-mixed-replace; boundary={_BOUNDARY}\r\n\r\n"
).encode()

_logger = logging.getLogger(__name__)


class MjpegServer:
    """One address, any number of readers, each with a thread and a short queue."""

    def __init__(self, host: str, port: int) -> None:
        self._listener = socket.create_server((host, port), backlog=4)
        self.host, self.port = self._listener.getsockname()[:2]
        self._lock = threading.Lock()
        self._readers: list[_Reader] = []
        self._open = True
        threading.Thread(target=self._accept, name="accept", daemon=True).start()

    @property
    def url(self) -> str:
        """Where the stream can be opened."""
        return f"http://{self.host}:{self.port}/stream.mjpg"

    def publish(self, jpeg: bytes) -> None:
        """Queue a frame for every reader."""
        with self._lock:
            readers = self._readers = [reader for reader in self._readers if reader.alive]
        for reader in readers:
            reader.put(jpeg)

    def close(self) -> None:
        """Hang up on every reader and free the port."""
        self._open = False
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        with self._lock:
            readers, self._readers = self._readers, []
        for reader in readers:
            reader.hang_up()

    def _accept(self) -> None:
        while self._open:
            try:
                connection, address = self._listener.accept()
            except OSError:
                return
            _logger.info("reader %s:%d connected", *address[:2])
            reader = _Reader(connection)
            with self._lock:
                self._readers.append(reader)


class _Reader:
    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._queue: deque[bytes] = deque(maxlen=_BACKLOG)
        self._wake = threading.Condition()
        self.alive = True
        threading.Thread(target=self._serve, name="reader", daemon=True).start()

    def put(self, jpeg: bytes) -> None:
        with self._wake:
            self._queue.append(jpeg)
            self._wake.notify()

    def hang_up(self) -> None:
        self.alive = False
        with contextlib.suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)
        with self._wake:
            self._wake.notify()

    def _serve(self) -> None:
        try:
            self._connection.settimeout(5.0)
            self._connection.recv(4096)
            self._connection.settimeout(None)
            self._connection.sendall(_HEADER)
            while self.alive:
                with self._wake:
                    self._wake.wait_for(lambda: self._queue or not self.alive)
                    waiting = [self._queue.popleft()] if self._queue else []
                for jpeg in waiting:
                    self._send(jpeg)
        except OSError as error:
            _logger.info("reader left: %s", error)
        finally:
            self.alive = False
            self._connection.close()

    def _send(self, jpeg: bytes) -> None:
        head = f"--{_BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
        self._connection.sendall(b"".join((head.encode(), jpeg, b"\r\n")))
