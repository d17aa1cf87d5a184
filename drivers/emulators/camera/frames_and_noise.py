"""An emulated camera: a process that serves frames of the plant over HTTP, or to a V4L2 device.

The process prints one JSON line with its URL or path. Frames are captured on absolute deadlines and
leave the camera's latency later.

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
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import lru_cache, partial
from importlib import resources
from pathlib import Path
from typing import NamedTuple
from urllib.parse import urlsplit

import cv2
import numpy as np

from drivers.emulators.faults import Device, FaultKind, FaultyLine, SilentImageFaults
from drivers.emulators.plant.gel_image_and_lights import GelCamera, Region
from drivers.emulators.plant.gel_response import Plant
from drivers.emulators.plant.truth import PlantTruth
from drivers.emulators.process import DeviceSettings, Service, keep_time, run_device, short_address
from drivers.emulators.shared_world import WORLD_FILE, SharedWorld, plant_of
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.config.settings import VideoDeviceName
from tacauchy_rig.core.errors import DeviceError

_logger = logging.getLogger(__name__)

_BACKLOG = 4  # frames that wait for a slow reader before the oldest is lost

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
VIDEO_DEVICE = "video0"  # name of the device's file in the folder of the emulated devices
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


_MARGIN_PX = 64


class NoisePool:
    """Gaussian noise for frames of one size; each use begins at another place of the pool."""

    def __init__(self, truth: PlantTruth, width: int, height: int) -> None:
        self._random = np.random.default_rng([truth.seed, 4])
        shape = (height + _MARGIN_PX, width + _MARGIN_PX, 3)
        # Two pools, because OpenCV adds and subtracts bytes several times faster than it adds
        # signed numbers to them.
        self._above, self._below = np.empty(shape, np.uint8), np.empty(shape, np.uint8)
        for row in range(0, shape[0], _MARGIN_PX):  # in parts: the floats need four times the room
            part = self._random.standard_normal(
                (min(_MARGIN_PX, shape[0] - row), *shape[1:]), np.float32
            )
            levels = np.round(part * truth.image_noise_levels)
            self._above[row : row + _MARGIN_PX] = np.maximum(levels, 0.0)
            self._below[row : row + _MARGIN_PX] = np.maximum(-levels, 0.0)

    def added(self, image: ImageArray) -> ImageArray:
        """Return ``image`` [rows, columns, 3] with noise."""
        brighter = cv2.add(image, self._above[self._window()])
        return np.asarray(cv2.subtract(brighter, self._below[self._window()]), np.uint8)

    def _window(self) -> tuple[slice, slice]:
        """Return a frame's rows and columns, anywhere in a pool."""
        top, left = self._random.integers(0, _MARGIN_PX + 1, 2)
        rows, columns = self._above.shape[0] - _MARGIN_PX, self._above.shape[1] - _MARGIN_PX
        return slice(top, top + rows), slice(left, left + columns)


DEPTH_STEP_M = 4e-6
PLACE_STEP_M = 1e-5
LIGHT_STEP = 2e-3
# Contacts: a dwell shows a few, and a press none twice.
_KEPT_COUNT = 64
_OVEREXPOSURE = 4.0


class PressKey(NamedTuple):
    """What distinguishes one rendered contact from another, in the steps above."""

    depth: int = 0  # of the unloaded gel
    x: int = 0
    y: int = 0
    light: int = 0


_Contact = tuple[Region, ImageArray] | None


class FrameFactory:
    """Makes frames of one plant: JPEG, or whatever ``encode`` makes of a BGR image.

    ``prepare`` may run in another thread than the rest: what it makes is published whole.
    """

    def __init__(
        self,
        plant: Plant,
        width: int,
        height: int,
        encode: Callable[[ImageArray], bytes] = encode_jpeg,
    ) -> None:
        self.plant = plant
        self._encode = encode
        self._camera = GelCamera(plant.truth, (width, height))
        self._noise = NoisePool(plant.truth, width, height)
        self._kept = lru_cache(_KEPT_COUNT)(self._rendered)
        self._shown: tuple[PressKey, _Contact] = PressKey(), None
        self._unloaded = self._camera.render(None)
        # Made beforehand: too much light holds no camera up.
        self._overexposed = self._camera.render(None, light=_OVEREXPOSURE)

    @property
    def newest(self) -> PressKey:
        """What was prepared last; the camera shows it until a newer one is."""
        return self._shown[0]

    def prepare(self, key: PressKey) -> None:
        """Render what the next frames show."""
        contact = self._kept(key) if key.depth > 0 else None
        if key.light != self.newest.light:
            self._unloaded = self._camera.render(None, light=_gain(key))
        self._shown = key, contact

    def compose(self, *, overexposed: bool = False) -> bytes:
        """Return the newest frame, or one in which far too much light drowns everything."""
        image, (_, contact) = self._unloaded.copy(), self._shown
        if overexposed:
            image = self._overexposed
        elif contact is not None:
            region, seen = contact
            image[region] = seen
        return self._encode(self._noise.added(self._camera.enlarged(image)))

    def _rendered(self, key: PressKey) -> _Contact:
        """Return what a press changes, where and how it is seen; None where that is nothing."""
        place = (key.x * PLACE_STEP_M, key.y * PLACE_STEP_M)
        profile = self.plant.surface_at(key.depth * DEPTH_STEP_M, place, self.plant.truth.tilt_rad)
        region = self._camera.region(profile)
        if region is None:
            return None
        return region, self._camera.render(profile, region=region, light=_gain(key))


def _gain(key: PressKey) -> float:
    return 1.0 + key.light * LIGHT_STEP


_GARBLED_BYTES = 64


def garbled(jpeg: bytes, source: random.Random) -> bytes:
    """Return a frame as a bad cable leaves it: bytes overwritten, its end cut off."""
    damaged = bytearray(jpeg[: source.randrange(len(jpeg) // 2, len(jpeg))])
    for _ in range(_GARBLED_BYTES):
        damaged[source.randrange(len(damaged) // 4, len(damaged))] ^= 0x5A
    return bytes(damaged)


_COMPOSING_S = 0.006  # left before a frame is due
_LATENCY_LIMIT = 0.8  # of a frame's period
_LATE_PERIODS = 4  # this far behind, the schedule is moved instead of caught up with


class EmulatedCamera:
    """One camera: its schedule, its faults and its readers."""

    def __init__(
        self,
        settings: DeviceSettings,
        service: Service,
        factory: FrameFactory,
        damage: Callable[[bytes, random.Random], bytes],
        plug_in: Callable[[], FrameServer],
    ) -> None:
        self._service, self._factory, self._plug_in = service, factory, plug_in
        self.server: FrameServer | None = plug_in()
        self._images = SilentImageFaults()
        self._line = FaultyLine(settings.config.emulation.seed, damage)
        self._world = SharedWorld.create(settings.folder / WORLD_FILE)
        self._renderer = ThreadPoolExecutor(1, thread_name_prefix="renderer")
        self._rendering: Future[None] | None = None
        self._period_s = 1.0 / settings.config.camera.rate
        truth = factory.plant.truth
        self.latency_s = min(truth.camera_latency_s, _LATENCY_LIMIT * self._period_s)
        self.start_ns = time.monotonic_ns() + 50_000_000

    def run(self) -> None:
        """Send frames until the camera's time is over."""
        number = 0
        moved_s = 0.0
        while not self._service.is_over:
            capture_s = self.start_ns * 1e-9 + moved_s + number * self._period_s
            behind_s = time.monotonic() - capture_s
            if behind_s > _LATE_PERIODS * self._period_s:
                moved_s += behind_s
                _logger.warning("%.0f ms behind: the schedule is moved", behind_s * 1e3)
                continue
            time.sleep(max(0.0, -behind_s))
            self._frame(capture_s)
            number += 1
        self.close()

    def _frame(self, capture_s: float) -> None:
        due_s = capture_s + self.latency_s
        # A gel that moves faster than it is rendered is seen late by one rendering, and not still.
        self._render(self._scene(capture_s), until_s=due_s - _COMPOSING_S)
        active = {each.kind: each for each in self._service.faults_at(time.monotonic())}
        self._plug(unplugged=FaultKind.UNPLUG in active)
        jpeg = self._factory.compose(overexposed=FaultKind.SATURATE in active)
        time.sleep(max(0.0, due_s - time.monotonic()))
        if self.server is not None:
            now_ns = time.monotonic_ns()
            self._line.put(self._images.frame(jpeg, active.values()), active, due_ns=now_ns)
            for frame in self._line.due(now_ns):
                self.server.publish(frame)

    def _render(self, key: PressKey, *, until_s: float) -> None:
        """Let the renderer work on ``key`` and wait for it; an older request is forgotten."""
        if self._rendering is not None:
            self._rendering.cancel()
        self._rendering = self._renderer.submit(self._factory.prepare, key)
        for done in wait([self._rendering], max(0.0, until_s - time.monotonic())).done:
            done.result()

    def _scene(self, capture_s: float) -> PressKey:
        """Return what to show; the unloaded gel if no arm is known."""
        plant = self._factory.plant
        elapsed_s = capture_s - self.start_ns * 1e-9
        light = round((plant.light_gain(elapsed_s) - 1.0) / LIGHT_STEP)
        state = self._world.read()
        if state.sequence == 0:
            return PressKey(light=light)
        depth_m = max(0.0, plant.depth(state.pose))
        x, y = (round(at / PLACE_STEP_M) for at in plant.centre(state.pose))
        return PressKey(round(depth_m / DEPTH_STEP_M), x, y, light)

    def _plug(self, *, unplugged: bool) -> None:
        if unplugged and self.server is not None:
            self.server.close()
            self.server = None
        elif not unplugged and self.server is None:
            self.server = self._plug_in()

    def close(self) -> None:
        """End the renderer and the server."""
        self._renderer.shutdown(cancel_futures=True)
        self._plug(unplugged=True)


def _serve(settings: DeviceSettings, service: Service) -> None:
    cv2.setNumThreads(1)
    asked, emulation = settings.config.camera, settings.config.emulation
    name = emulation.video_device
    encode = encode_jpeg if name is None else encoder_of(name)
    factory = FrameFactory(plant_of(settings), asked.width, asked.height, encode)
    keep_time(mostly_sleeps=False)
    place = settings.host, settings.port

    def listen() -> FrameServer:
        """Listen; once unplugged, again where it answered before."""
        nonlocal place
        server = mjpeg_server(*place)
        place = settings.host, urlsplit(server.address).port or 0
        return server

    offer = "" if name is None else description_of(name, width=asked.width, height=asked.height)
    plug_in = partial(serve_device, settings.folder / VIDEO_DEVICE, offer) if offer else listen
    damage = garbled if encode is encode_jpeg else without_a_packet
    camera = EmulatedCamera(settings, service, factory, damage, plug_in)
    service.announce(
        url=camera.server.address if camera.server else "",
        first_capture_ns=camera.start_ns,
        latency_s=camera.latency_s,
    )
    camera.run()


if __name__ == "__main__":
    sys.exit(run_device(Device.CAMERA, _serve))
