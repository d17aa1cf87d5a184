"""What carries the emulated camera's frames: an HTTP stream, or a V4L2 device of a library.

The library, ``video_device.c``, is preloaded into the programs that are to see the device. It
answers what a program asks of the kernel; frames come from here. A device is one text file, which
describes what it offers; programs open it as ``/dev/video0``.
"""

import contextlib
import logging
import os
import queue
import random
import socket
import struct
import subprocess
import threading
from collections.abc import Callable
from importlib import resources
from pathlib import Path

import cv2
import numpy as np

from drivers.emulators.process import short_address
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.config.settings import VideoDeviceName
from tacauchy_rig.core.errors import DeviceError

_BACKLOG = 4  # frames that wait for a slow reader before the oldest is lost

_logger = logging.getLogger(__name__)


_BOUNDARY = "frame"
_HEADER = (
    "HTTP/1.0 200 OK\r\nCache-Control: no-store\r\nConnection: close\r\n"
    f"Content-Type: multipart/x-mixed-replace; boundary={_BOUNDARY}\r\n\r\n"
).encode()
_Frames = queue.SimpleQueue[bytes | None]


class FrameServer:
    """One address, any number of readers, each with a thread and a short queue; speaks HTTP.

    Args:
        address: Where they come to: a URL, or the path of a device.
    """

    def __init__(self, listener: socket.socket, address: str) -> None:
        self._listener, self.address = listener, address
        self._lock = threading.Lock()
        self._readers: dict[socket.socket, _Frames] = {}
        threading.Thread(target=self._accept, name="accept", daemon=True).start()

    def publish(self, frame: bytes) -> None:
        """Queue a frame for every reader; for a slow one the oldest is lost."""
        with self._lock:
            readers = list(self._readers.values())
        for frames in readers:
            if frames.qsize() >= _BACKLOG:
                with contextlib.suppress(queue.Empty):
                    frames.get_nowait()
            frames.put(frame)

    def close(self) -> None:
        """Hang up on every reader and free the address."""
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        with self._lock:
            readers, self._readers = self._readers, {}
        for connection, frames in readers.items():
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
            frames.put(None)

    def _accept(self) -> None:
        with contextlib.suppress(OSError):  # closed
            while True:
                connection, _ = self._listener.accept()
                _logger.info("a reader connected to %s", self.address)
                frames = _Frames()
                with self._lock:
                    self._readers[connection] = frames
                serve = threading.Thread(target=self._serve, args=(connection, frames), daemon=True)
                serve.start()

    def _serve(self, connection: socket.socket, frames: _Frames) -> None:
        try:
            connection.settimeout(5.0)
            send = self._greet(connection)
            connection.settimeout(None)
            for frame in iter(frames.get, None):
                send(frame)
        except OSError as error:
            _logger.info("reader left: %s", error)
        finally:
            with self._lock:
                self._readers.pop(connection, None)
            connection.close()

    def _greet(self, connection: socket.socket) -> Callable[[bytes], None]:
        """Take what a reader asks for, answer it, and return what sends it a frame."""
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.recv(4096)
        connection.sendall(_HEADER)

        def send(frame: bytes) -> None:
            head = f"--{_BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(frame)}"
            connection.sendall(b"".join((head.encode(), b"\r\n\r\n", frame, b"\r\n")))

        return send


def mjpeg_server(host: str, port: int) -> FrameServer:
    """Serve an HTTP multipart JPEG stream; port 0 takes a free one.

    Raises:
        DeviceError: The port is taken.
    """
    try:
        listener = socket.create_server((host, port), backlog=4)
    except OSError as error:
        raise DeviceError(
            f"emulated camera: {host}:{port} cannot be listened on ({error.strerror})",
            remedy="give another --port, or 0 for a free one",
        ) from error
    host, port = listener.getsockname()[:2]
    return FrameServer(listener, f"http://{host}:{port}/stream.mjpg")


# 0.84 MB at 3280x2464, what the real camera sends.
_ENCODING = (
    *(cv2.IMWRITE_JPEG_QUALITY, 94),
    *(cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420),
)


def encode_jpeg(image: ImageArray) -> bytes:
    """Return a BGR image [rows, columns, 3] as the JPEG that a GelSight Mini would send."""
    encoded, data = cv2.imencode(".jpg", image, _ENCODING)
    if not encoded:
        raise DeviceError(f"emulated camera: a frame of {image.shape} could not be encoded")
    return data.tobytes()


_ERROR = 0x40  # V4L2_BUF_FLAG_ERROR
_PACKET_BYTES = 3060  # what a high-bandwidth USB packet holds of a frame
VIDEO_DEVICE = "video0"
"""Name of the device's file in the folder of the emulated devices."""
_LIBRARY = "video_device.so"
_PACKAGE = "drivers.emulators.camera"


_DAMAGED = b"\0without a packet\0"


def serve_device(path: Path, description: str) -> FrameServer:
    """Plug a device in at ``path``, as good as new; it goes when the server is closed."""
    path.with_name(f"{path.name}.wedged").unlink(missing_ok=True)
    frames = path.with_name(f"{path.name}.frames")
    frames.unlink(missing_ok=True)
    listener = socket.socket(socket.AF_UNIX)
    with short_address(frames) as address:
        listener.bind(address)
    listener.listen()
    path.write_text(description)
    return _DeviceServer(listener, str(path))


class _DeviceServer(FrameServer):
    """Feeds a device while it streams; one that is wedged asks for 0 frames a second."""

    def _greet(self, connection: socket.socket) -> Callable[[bytes], None]:
        asked = connection.recv(64).decode()
        _logger.info("the device streams %s", asked.strip())

        def send(frame: bytes) -> None:
            flags = _ERROR if frame.startswith(_DAMAGED) else 0
            data = frame.removeprefix(_DAMAGED)
            if not asked.endswith(" 0\n"):
                connection.sendall(struct.pack("=2I", len(data), flags) + data)

        return send

    def close(self) -> None:
        """Pull the plug: the device's file goes first, as udev removes it."""
        Path(self.address).unlink(missing_ok=True)
        Path(f"{self.address}.frames").unlink(missing_ok=True)
        super().close()


def description_of(name: VideoDeviceName, *, width: int = 640, height: int = 480) -> str:
    """Return what a known camera offers, as the library reads it.

    A GelSight Mini, whose one size few computers can emulate in time, offers the given one too.
    """
    text = resources.files(_PACKAGE).joinpath(f"{name.value}.txt").read_text("ascii")
    return text.format(width=width, height=height)


def encoder_of(name: VideoDeviceName) -> Callable[[ImageArray], bytes]:
    """Return what makes a frame of a BGR image [rows, columns, 3], in the camera's first format."""
    is_raw = "mode YUYV" in description_of(name)
    return encode_yuyv if is_raw else encode_jpeg


def encode_yuyv(image: ImageArray) -> bytes:
    """Return a BGR image [rows, columns, 3] as YUYV."""
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2YUV_YUYV), np.uint8).tobytes()


def without_a_packet(frame: bytes, source: random.Random) -> bytes:
    """Return an uncompressed frame that has lost a USB packet: the rest of it moves up."""
    start = source.randrange(0, len(frame) - _PACKET_BYTES)
    return _DAMAGED + frame[:start] + frame[start + _PACKET_BYTES :]


def preloaded(path: Path) -> dict[str, str]:
    """Compile the library beside a device; return the variables by which a program sees it.

    Raises:
        DeviceError: There is no C compiler.
    """
    library = path.with_name(_LIBRARY)
    source = resources.files(_PACKAGE).joinpath("video_device.c").read_bytes()
    command = ["cc", "-O1", "-shared", "-fPIC", "-o", str(library), "-x", "c", "-"]
    try:
        subprocess.run(command, input=source, check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError) as error:
        said = getattr(error, "stderr", b"") or b""
        raise DeviceError(
            f"the emulated V4L2 device cannot be compiled: {error} "
            f"{said.decode(errors='replace')}".strip(),
            remedy="install a C compiler that answers to `cc`, such as gcc",
        ) from error
    libraries = filter(None, (str(library), os.environ.get("LD_PRELOAD")))
    return {"LD_PRELOAD": ":".join(libraries), "VIDEO_DEVICE": str(path)}
