"""The emulated camera as a V4L2 device of programs that a library is preloaded into.

The library, ``video_device.c``, answers what a program asks of the kernel; frames come from here. A
device is one text file, which describes what it offers; programs open it as ``/dev/video0``.
"""

from __future__ import annotations

import logging
import os
import random
import socket
import struct
import subprocess
from collections.abc import Callable
from importlib import resources
from pathlib import Path

import cv2
import numpy as np

from drivers.emulators.camera.frame_server import FrameServer, Reader
from drivers.emulators.camera.frames import encode_jpeg
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.config.model import VideoDeviceName
from tacauchy_rig.core.errors import DeviceError

_ERROR = 0x40  # V4L2_BUF_FLAG_ERROR
_PACKET_BYTES = 3060  # what a high-bandwidth USB packet holds of a frame
VIDEO_DEVICE = "video0"
"""Name of the device's file in the folder of the emulated devices."""
_LIBRARY = "video_device.so"
_PACKAGE = "drivers.emulators.camera"

_logger = logging.getLogger(__name__)


class _DeviceReader(Reader):
    """Feeds a device while it streams; one that is wedged asks for 0 frames a second."""

    def greet(self) -> None:
        asked = self.connection.recv(64).decode()
        _logger.info("the device streams %s", asked.strip())
        self._is_wedged = asked.endswith(" 0\n")
        self.connection.settimeout(None)

    def send(self, frame: bytes) -> None:
        if self._is_wedged:
            return
        flags = _ERROR if frame.startswith(_DAMAGED) else 0
        data = frame.removeprefix(_DAMAGED)
        self.connection.sendall(struct.pack("=2I", len(data), flags) + data)


_DAMAGED = b"\0without a packet\0"


def serve_device(path: Path, description: str) -> FrameServer:
    """Plug a device in at ``path``, as good as new; it goes when the server is closed.

    Raises:
        OSError: The folder cannot be written.
    """
    path.with_name(f"{path.name}.wedged").unlink(missing_ok=True)
    frames = path.with_name(f"{path.name}.frames")
    frames.unlink(missing_ok=True)
    listener = socket.socket(socket.AF_UNIX)
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:  # by an address that fits the 107 bytes that Unix sockets allow
        listener.bind(f"/proc/self/fd/{folder}/{frames.name}")
    finally:
        os.close(folder)
    listener.listen()
    path.write_text(description)
    return _DeviceServer(listener, _DeviceReader, str(path))


class _DeviceServer(FrameServer):
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
