"""An emulated camera: a process that serves frames of the plant over HTTP, or to a V4L2 device.

The process prints one JSON line with its URL or path. Frames are captured on absolute deadlines and
leave the camera's latency later.
"""

from __future__ import annotations

import logging
import random
import sys
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import lru_cache, partial
from urllib.parse import urlsplit

import cv2
import numpy as np

from drivers.emulators.camera.frame_server import (
    VIDEO_DEVICE,
    FrameServer,
    description_of,
    encode_jpeg,
    encoder_of,
    mjpeg_server,
    serve_device,
    without_a_packet,
)
from drivers.emulators.faults import Device, Fault, FaultKind, FaultyLine
from drivers.emulators.plant.gel import Plant
from drivers.emulators.plant.optics import GelCamera, Region
from drivers.emulators.plant.truth import PlantTruth
from drivers.emulators.process import DeviceSettings, Service, keep_time, run_device
from drivers.emulators.shared_world import WORLD_FILE, SharedWorld, plant_of
from drivers.emulators.silent_faults import SilentImageFaults
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.errors import DeviceError

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


@dataclass(frozen=True, slots=True)
class PressKey:
    """What distinguishes one rendered contact from another, in the steps above."""

    depth: int
    x: int
    y: int
    light: int

    @property
    def is_contact(self) -> bool:
        """False for the unloaded gel."""
        return self.depth > 0


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
        self._shown: tuple[PressKey, _Contact] = PressKey(depth=0, x=0, y=0, light=0), None
        self._unloaded = self._camera.render(None)
        # Made beforehand: too much light holds no camera up.
        self._overexposed = self._camera.render(None, light=_OVEREXPOSURE)

    @property
    def newest(self) -> PressKey:
        """What was prepared last; the camera shows it until a newer one is."""
        return self._shown[0]

    def prepare(self, key: PressKey) -> None:
        """Render what the next frames show."""
        contact = self._kept(key) if key.is_contact else None
        if key.light != self.newest.light:
            self._unloaded = self._camera.render(None, light=_gain(key))
        self._shown = key, contact

    def compose(self) -> bytes:
        """Return the newest frame."""
        image, (_, contact) = self._unloaded.copy(), self._shown
        if contact is not None:
            region, seen = contact
            image[region] = seen
        return self._sent(image)

    def compose_overexposed(self) -> bytes:
        """Return a frame in which far too much light drowns everything."""
        return self._sent(self._overexposed)

    def _rendered(self, key: PressKey) -> _Contact:
        """Return what a press changes, where and how it is seen; None where that is nothing."""
        place = (key.x * PLACE_STEP_M, key.y * PLACE_STEP_M)
        profile = self.plant.surface_at(key.depth * DEPTH_STEP_M, place, self.plant.truth.tilt_rad)
        region = self._camera.region(profile)
        if region is None:
            return None
        return region, self._camera.render(profile, region=region, light=_gain(key))

    def _sent(self, image: ImageArray) -> bytes:
        return self._encode(self._noise.added(self._camera.enlarged(image)))


def _gain(key: PressKey) -> float:
    return 1.0 + key.light * LIGHT_STEP


class BackgroundRenderer:
    """One thread that always works on the newest request."""

    def __init__(self, factory: FrameFactory) -> None:
        self._factory = factory
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="renderer")
        self._request: Future[None] | None = None

    def ask(self, key: PressKey, *, timeout_s: float) -> None:
        """Ask for ``key`` and wait at most ``timeout_s`` [s]; an older request is forgotten."""
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


_COMPOSING_S = 0.006  # left before a frame is due
_LATENCY_LIMIT = 0.8  # of a frame's period
_LATE_PERIODS = 4  # this far behind, the schedule is moved instead of caught up with

_logger = logging.getLogger(__name__)


class EmulatedCamera:
    """One camera: its schedule, its faults and its readers."""

    def __init__(
        self,
        settings: DeviceSettings,
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
        self._world = SharedWorld.create(settings.folder / WORLD_FILE)
        self._renderer = BackgroundRenderer(factory)
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
        self._close()

    def _frame(self, capture_s: float) -> None:
        due_s = capture_s + self.latency_s
        # A gel that moves faster than it is rendered is seen late by one rendering, and not still.
        wanted, timeout_s = self._scene(capture_s), due_s - _COMPOSING_S - time.monotonic()
        self._renderer.ask(wanted, timeout_s=timeout_s)
        faults = self._active_faults()
        if any(fault.kind is FaultKind.SATURATE for fault in faults):
            jpeg = self._factory.compose_overexposed()
        else:
            jpeg = self._factory.compose()
        time.sleep(max(0.0, due_s - time.monotonic()))
        if self._server is not None:
            for frame in self._output.frames(jpeg, faults, now_s=time.monotonic()):
                self._server.publish(frame)

    def _scene(self, capture_s: float) -> PressKey:
        """Return what to show; the unloaded gel if no arm is known."""
        plant = self._factory.plant
        elapsed_s = capture_s - self.start_ns * 1e-9
        light = round((plant.light_gain(elapsed_s) - 1.0) / LIGHT_STEP)
        state = self._world.read()
        if state.sequence == 0:
            return PressKey(depth=0, x=0, y=0, light=light)
        depth_m = max(0.0, plant.depth(state.pose))
        x, y = plant.centre(state.pose)
        return PressKey(
            depth=round(depth_m / DEPTH_STEP_M),
            x=round(x / PLACE_STEP_M),
            y=round(y / PLACE_STEP_M),
            light=light,
        )

    def _active_faults(self) -> list[Fault]:
        faults = self._service.faults_at(time.monotonic())
        unplugged = any(fault.kind is FaultKind.UNPLUG for fault in faults)
        if unplugged and self._server is not None:
            self._server.close()
            self._server = None
        elif not unplugged and self._server is None:
            self._server = self._plug_in()
        return faults

    def _close(self) -> None:
        self._renderer.close()
        if self._server is not None:
            self._server.close()


def _serve(settings: DeviceSettings, service: Service) -> None:
    cv2.setNumThreads(1)
    asked, emulation = settings.config.camera, settings.config.emulation
    name = emulation.video_device
    encode = encode_jpeg if name is None else encoder_of(name)
    factory = FrameFactory(plant_of(settings), asked.width, asked.height, encode)
    keep_time(mostly_sleeps=False)
    if name is None:
        server = _listen(settings.host, settings.port)
        port = urlsplit(server.address).port or 0
        plug_in = partial(_listen, settings.host, port)  # again where it answers now
    else:
        offer = description_of(name, width=asked.width, height=asked.height)
        plug_in = partial(serve_device, settings.folder / VIDEO_DEVICE, offer)
        server = plug_in()
    damage = _garbled if encode is encode_jpeg else without_a_packet
    output = FaultyOutput(emulation.seed, damage)
    camera = EmulatedCamera(settings, service, factory, output, server, plug_in)
    service.announce(
        url=server.address,
        width=asked.width,
        height=asked.height,
        rate_hz=asked.rate,
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
    sys.exit(run_device(Device.CAMERA, _serve))
