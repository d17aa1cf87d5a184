"""An emulated camera: a process that serves an HTTP multipart JPEG stream of the plant.

``python -m drivers.emulators.camera.stream --folder DIR --width 640 --height 480 --rate 25``
prints one JSON line with its URL. Frames are captured on absolute deadlines and leave the camera's
latency later; their numbers are drawn in, and ``camera_trace.jsonl`` holds what each one shows.
"""

from __future__ import annotations

import contextlib
import json
import logging
import random
import socket
import sys
import threading
import time
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import TextIO

import cv2

from drivers.emulators.camera.frames import (
    DEPTH_STEP_M,
    LIGHT_STEP,
    PLACE_STEP_M,
    FrameFactory,
    PressKey,
)
from drivers.emulators.faults import Device, Fault, FaultKind, FaultyLine
from drivers.emulators.process import Service, keep_time, run_device
from drivers.emulators.shared_world import WORLD_FILE, GelSettings, SharedWorld, WorldState
from drivers.emulators.silent_faults import SilentImageFaults
from tacauchy_rig.core.errors import DeviceError


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSettings(GelSettings):
    """How one emulated camera is set up; it serves an HTTP multipart JPEG stream of the gel.

    The world lies in the folder if none is given.

    Attributes:
        host: Address to serve at.
        port: Its port; 0 takes a free one.
        width: Of the frames [px].
        height: Of the frames [px].
        rate: Frames per second.
    """

    host: str = "127.0.0.1"
    port: int = 0
    width: int = 640
    height: int = 480
    rate: float = 25.0


class BackgroundRenderer:
    """One thread that always works on the newest request."""

    def __init__(self, factory: FrameFactory) -> None:
        self._factory = factory
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="renderer")
        self._request: Future[None] | None = None

    def ask(self, key: PressKey, *, timeout_s: float) -> None:
        """Ask for ``key`` and wait for it at most ``timeout_s`` [s]; an older request is forgotten.

        Raises:
            DeviceError: It could not be rendered.
        """
        if self._request is not None:
            self._request.cancel()
        self._request = self._thread.submit(self._factory.prepare, key)
        for done in wait([self._request], max(0.0, timeout_s)).done:
            done.result()

    def close(self) -> None:
        """End the thread."""
        self._thread.shutdown(cancel_futures=True)


_GARBLED_BYTES = 64


class FaultyOutput:
    """Turns the frame that should go out into the frames that do."""

    def __init__(self, seed: int) -> None:
        self._images = SilentImageFaults()
        self._line = FaultyLine(seed, _garbled)

    def frames(self, jpeg: bytes, faults: list[Fault], *, now_s: float) -> list[bytes]:
        """Return what to send at ``now_s`` [s] in place of ``jpeg``, oldest first."""
        now_ns = round(now_s * 1e9)
        active = {fault.kind: fault for fault in faults}
        self._line.put(self._images.frame(jpeg, faults), active, due_ns=now_ns)
        return [] if FaultKind.STALL in active else self._line.due(now_ns)


def _garbled(jpeg: bytes, source: random.Random) -> bytes:
    """Overwrite bytes and cut the end off, as a bad cable does."""
    damaged = bytearray(jpeg[: source.randrange(len(jpeg) // 2, len(jpeg))])
    for _ in range(_GARBLED_BYTES):
        damaged[source.randrange(len(damaged) // 4, len(damaged))] ^= 0x5A
    return bytes(damaged)


TRACE_FILE = "camera_trace.jsonl"
_COMPOSING_S = 0.006  # left before a frame is due
_LATENCY_LIMIT = 0.8  # of a frame's period
_FLUSH_FRAMES = 25
_LATE_PERIODS = 4  # this far behind, the schedule is moved instead of caught up with

_logger = logging.getLogger(__name__)


class EmulatedCamera:
    """One camera: its schedule, its faults and its readers."""

    def __init__(
        self,
        settings: CameraSettings,
        service: Service,
        factory: FrameFactory,
        server: MjpegServer,
    ) -> None:
        self._service = service
        self._factory = factory
        self._server: MjpegServer | None = server
        self._address = (server.host, server.port)
        self._world_path = settings.world or settings.folder / WORLD_FILE
        self._world: SharedWorld | None = None
        self._output = FaultyOutput(settings.seed)
        self._renderer = BackgroundRenderer(factory)
        self._period_s = 1.0 / settings.rate
        truth = factory.plant.truth
        self.latency_s = min(truth.camera_latency_s, _LATENCY_LIMIT * self._period_s)
        self._trace: TextIO = (settings.folder / TRACE_FILE).open("w")
        self._shown = PressKey(depth=0, x=0, y=0, light=0)
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
            self._frame(number, capture_s)
            number += 1
        self._close()

    def _frame(self, number: int, capture_s: float) -> None:
        wanted, depth_m = self._scene(capture_s)
        due_s = capture_s + self.latency_s
        self._renderer.ask(wanted, timeout_s=due_s - _COMPOSING_S - time.monotonic())
        if self._factory.is_ready(wanted):
            self._shown = wanted
        faults = self._active_faults()
        if any(fault.kind is FaultKind.SATURATE for fault in faults):
            jpeg = self._factory.compose_overexposed(number)
        else:
            jpeg = self._factory.compose(self._shown, number)
        time.sleep(max(0.0, due_s - time.monotonic()))
        if self._server is not None:
            for frame in self._output.frames(jpeg, faults, now_s=time.monotonic()):
                self._server.publish(frame)
        self._write_trace(number, capture_s, depth_m)

    def _scene(self, capture_s: float) -> tuple[PressKey, float]:
        """Return what to show and how deep the tip really is [m]; the gel if no arm is known."""
        plant = self._factory.plant
        elapsed_s = capture_s - self.start_ns * 1e-9
        light = round((plant.light_gain(elapsed_s) - 1.0) / LIGHT_STEP)
        state = self._read_world()
        if state is None or state.sequence == 0:
            return PressKey(depth=0, x=0, y=0, light=light), 0.0
        depth_m = max(0.0, plant.depth(state.pose))
        x, y = plant.centre(state.pose)
        key = PressKey(
            depth=round(depth_m / DEPTH_STEP_M),
            x=round(x / PLACE_STEP_M),
            y=round(y / PLACE_STEP_M),
            light=light,
        )
        return key, depth_m

    def _read_world(self) -> WorldState | None:
        """Return the arm's state, or None until another process has created the world."""
        if self._world is None:
            if not self._world_path.exists():
                return None
            self._world = SharedWorld.open(self._world_path)
        return self._world.read()

    def _active_faults(self) -> list[Fault]:
        faults = self._service.faults_at(time.monotonic())
        unplugged = any(fault.kind is FaultKind.UNPLUG for fault in faults)
        if unplugged and self._server is not None:
            self._server.close()
            self._server = None
        elif not unplugged and self._server is None:
            self._server = _listen(*self._address)
        return faults

    def _write_trace(self, number: int, capture_s: float, depth_m: float) -> None:
        line = {
            "number": number,
            "capture_ns": round(capture_s * 1e9),
            "depth_true_m": depth_m,
            "depth_shown_m": self._shown.depth * DEPTH_STEP_M,
        }
        self._trace.write(json.dumps(line) + "\n")
        if number % _FLUSH_FRAMES == 0:
            self._trace.flush()

    def _close(self) -> None:
        self._renderer.close()
        self._trace.close()
        if self._server is not None:
            self._server.close()


def _serve(settings: CameraSettings, service: Service) -> None:
    cv2.setNumThreads(1)
    factory = FrameFactory(settings.plant(), settings.width, settings.height)
    keep_time(mostly_sleeps=False)
    server = _listen(settings.host, settings.port)
    camera = EmulatedCamera(settings, service, factory, server)
    service.announce(
        url=server.url,
        width=settings.width,
        height=settings.height,
        rate_hz=settings.rate,
        first_capture_ns=camera.start_ns,
        latency_s=camera.latency_s,
    )
    camera.run()


def _listen(host: str, port: int) -> MjpegServer:
    try:
        return MjpegServer(host, port)
    except OSError as error:
        raise DeviceError(
            f"emulated camera: {host}:{port} cannot be listened on ({error.strerror})",
            remedy="give another --port, or 0 for a free one",
        ) from error


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


if __name__ == "__main__":
    sys.exit(run_device(CameraSettings, Device.CAMERA, _serve))
