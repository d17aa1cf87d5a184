"""What carries the emulated camera's frames: an HTTP stream, and what it shares with V4L2."""

from __future__ import annotations

import contextlib
import logging
import socket
import threading
from collections import deque

_BACKLOG = 4  # frames that wait for a slow reader before the oldest is lost

_logger = logging.getLogger(__name__)


class Reader:
    """One connection, with a thread and a short queue of frames; speaks HTTP."""

    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        self._queue: deque[bytes] = deque(maxlen=_BACKLOG)
        self._wake = threading.Condition()
        self.alive = True
        threading.Thread(target=self._serve, name="reader", daemon=True).start()

    def put(self, frame: bytes) -> None:
        """Queue a frame."""
        with self._wake:
            self._queue.append(frame)
            self._wake.notify()

    def hang_up(self) -> None:
        """End the connection."""
        self.alive = False
        with contextlib.suppress(OSError):
            self.connection.shutdown(socket.SHUT_RDWR)
        with self._wake:
            self._wake.notify()

    def greet(self) -> None:
        """Take what the reader asks for, and answer it."""
        self.connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.connection.recv(4096)
        self.connection.sendall(_HEADER)

    def send(self, frame: bytes) -> None:
        """Send a frame."""
        head = f"--{_BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(frame)}\r\n\r\n"
        self.connection.sendall(b"".join((head.encode(), frame, b"\r\n")))

    def _serve(self) -> None:
        try:
            self.connection.settimeout(5.0)
            self.greet()
            self.connection.settimeout(None)
            while self.alive:
                with self._wake:
                    self._wake.wait_for(lambda: self._queue or not self.alive)
                    waiting = [self._queue.popleft()] if self._queue else []
                for frame in waiting:
                    self.send(frame)
        except OSError as error:
            _logger.info("reader left: %s", error)
        finally:
            self.alive = False
            self.connection.close()


_BOUNDARY = "frame"
_HEADER = (
    "HTTP/1.0 200 OK\r\nCache-Control: no-store\r\nConnection: close\r\n"
    f"Content-Type: multipart/x-mixed-replace; boundary={_BOUNDARY}\r\n\r\n"
).encode()


class FrameServer:
    """One address, any number of readers.

    Args:
        listener: Accepts them.
        reader: Speaks with one.
        address: Where they come to: a URL, or the path of a device.
    """

    def __init__(self, listener: socket.socket, reader: type[Reader], address: str) -> None:
        self._listener, self._reader = listener, reader
        self.address = address
        self._lock = threading.Lock()
        self._readers: list[Reader] = []
        self._open = True
        threading.Thread(target=self._accept, name="accept", daemon=True).start()

    def publish(self, frame: bytes) -> None:
        """Queue a frame for every reader."""
        with self._lock:
            readers = self._readers = [reader for reader in self._readers if reader.alive]
        for reader in readers:
            reader.put(frame)

    def close(self) -> None:
        """Hang up on every reader and free the address."""
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
                connection, _ = self._listener.accept()
            except OSError:
                return
            _logger.info("a reader connected to %s", self.address)
            reader = self._reader(connection)
            with self._lock:
                self._readers.append(reader)


def mjpeg_server(host: str, port: int) -> FrameServer:
    """Serve an HTTP multipart JPEG stream.

    Raises:
        OSError: The address cannot be listened on.
    """
    listener = socket.create_server((host, port), backlog=4)
    host, port = listener.getsockname()[:2]
    return FrameServer(listener, Reader, f"http://{host}:{port}/stream.mjpg")
