"""An emulated camera: a process that serves frames of the plant over HTTP, or to a V4L2 device.

``python -m drivers.emulators.camera.stream --folder DIR --width 640 --height 480 --rate 25``
prints one JSON line with its URL or path. Frames are captured on absolute deadlines and leave the
camera's latency later; their numbers are drawn in, and ``camera_trace.jsonl`` holds what each one
shows.
"""

from __future__ import annotations

import json
import logging
import random
import sys
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import partial
from typing import TextIO
from urllib.parse import urlsplit

import cv2

from drivers.emulators.camera.frame_server import FrameServer, mjpeg_server
from drivers.emulators.camera.frames import (
    DEPTH_STEP_M,
    LIGHT_STEP,
    PLACE_STEP_M,
    FrameFactory,
    PressKey,
    encode_jpeg,
)
from drivers.emulators.camera.video_device import (
    VIDEO_DEVICE,
    description_of,
    encoder_of,
    serve_device,
    without_a_packet,
)
from drivers.emulators.faults import Device, Fault, FaultKind, FaultyLine
from drivers.emulators.process import Service, keep_time, run_device
from drivers.emulators.shared_world import WORLD_FILE, GelSettings, SharedWorld, WorldState
from drivers.emulators.silent_faults import SilentImageFaults
from tacauchy_rig.core.config.model import VideoDeviceName
from tacauchy_rig.core.errors import DeviceError


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSettings(GelSettings):
    """How one emulated camera is set up: an HTTP multipart JPEG stream of the gel, or V4L2.

    The world lies in the folder if none is given.

    Attributes:
        host: Address to serve at.
        port: Its port; 0 takes a free one.
        width: Of the frames [px].
        height: Of the frames [px].
        rate: Frames per second.
        video_device: Camera to play through V4L2, in place of the stream.
    """

    host: str = "127.0.0.1"
    port: int = 0
    width: int = 640
    height: int = 480
    rate: float = 25.0
    video_device: VideoDeviceName | None = None


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


def _garbled(jpeg: bytes, source: random.Random) -> bytes:
    """Overwrite bytes and cut the end off, as a bad cable does."""
    damaged = bytearray(jpeg[: source.randrange(len(jpeg) // 2, len(jpeg))])
    for _ in range(_GARBLED_BYTES):
        damaged[source.randrange(len(damaged) // 4, len(damaged))] ^= 0x5A
    return bytes(damaged)


class FaultyOutput:
    """Turns the frame that should go out into the frames that do."""

    def __init__(
        self, seed: int, damage: Callable[[bytes, random.Random], bytes] = _garbled
    ) -> None:
        self._images = SilentImageFaults()
        self._line = FaultyLine(seed, damage)

    def frames(self, jpeg: bytes, faults: list[Fault], *, now_s: float) -> list[bytes]:
        """Return what to send at ``now_s`` [s] in place of ``jpeg``, oldest first."""
        now_ns = round(now_s * 1e9)
        active = {fault.kind: fault for fault in faults}
        self._line.put(self._images.frame(jpeg, faults), active, due_ns=now_ns)
        return [] if FaultKind.STALL in active else self._line.due(now_ns)


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
        output: FaultyOutput,
        server: FrameServer,
        plug_in: Callable[[], FrameServer],
    ) -> None:
        self._service = service
        self._factory = factory
        self._output = output
        self._server: FrameServer | None = server
        self._plug_in = plug_in
        self._world_path = settings.world or settings.folder / WORLD_FILE
        self._world: SharedWorld | None = None
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
        # A gel that moves faster than it is rendered is seen late by one rendering, and not still.
        self._shown = self._factory.newest if wanted.is_contact else wanted
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
            self._server = self._plug_in()
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
    name = settings.video_device
    encode = encode_jpeg if name is None else encoder_of(name)
    factory = FrameFactory(settings.plant(), settings.width, settings.height, encode)
    keep_time(mostly_sleeps=False)
    if name is None:
        server = _listen(settings.host, settings.port)
        port = urlsplit(server.address).port or 0
        plug_in = partial(_listen, settings.host, port)  # again where it answers now
    else:
        offer = description_of(name, width=settings.width, height=settings.height)
        plug_in = partial(serve_device, settings.folder / VIDEO_DEVICE, offer)
        server = plug_in()
    damage = _garbled if encode is encode_jpeg else without_a_packet
    output = FaultyOutput(settings.seed, damage)
    camera = EmulatedCamera(settings, service, factory, output, server, plug_in)
    service.announce(
        url=server.address,
        width=settings.width,
        height=settings.height,
        rate_hz=settings.rate,
        first_capture_ns=camera.start_ns,
        latency_s=camera.latency_s,
    )
    camera.run()


def _listen(host: str, port: int) -> FrameServer:
    try:
        return mjpeg_server(host, port)
    except OSError as error:
        raise DeviceError(
            f"emulated camera: {host}:{port} cannot be listened on ({error.strerror})",
            remedy="give another --port, or 0 for a free one",
        ) from error


if __name__ == "__main__":
    sys.exit(run_device(CameraSettings, Device.CAMERA, _serve))
