"""Mock force sensor and camera: samples made as the mock world steps."""

import functools
import math
from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Any, ClassVar, Generic, Self, TypeVar

import cv2
import numpy as np

from drivers.emulators.faults import Device, FaultKind, SilentImageFaults, SilentWrenchFaults
from drivers.interfaces import Clock, DeviceIdentity, StreamHealth
from drivers.stream_buffer_and_repeats import StreamBuffer
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.run import ForceSample, ImageFrame
from tests.mock.world import STEP_S, MockWorld

SampleT = TypeVar("SampleT")

WIDTH, HEIGHT = 64, 48


class _MockStream(ABC, Generic[SampleT]):
    """A ``StreamingDevice`` without a wire, at a rate [Hz] in the world's time."""

    place: ClassVar[str]
    model: ClassVar[str]
    device: ClassVar[Device]
    first_s: ClassVar[float]
    settings: ClassVar[dict[str, str]] = {}

    def __init__(self, world: MockWorld, *, rate_hz: float) -> None:
        self.world = world
        self._period_ns = round(1e9 / rate_hz)
        self._next_ns = world.now_ns + round(STEP_S * 1e9)
        self._counter = self._lost_count = self._corrupt_count = 0
        self._buffer = StreamBuffer[SampleT](capacity=1_000_000, now_ns=world.clock.now_ns)
        world.on_step(self._step)

    def connect(self) -> DeviceIdentity:
        """Answer once the first sample is there."""
        self.world.clock.sleep(self.first_s)
        self.world.catch_up()
        return DeviceIdentity(
            driver="mock",
            address="in process",
            model=self.model,
            serial="0",
            simulated=True,
            settings=dict(self.settings),
        )

    def drain(self) -> list[SampleT]:
        """Return the samples since the last call.

        Raises:
            DeviceError: It was unplugged.
        """
        self.world.catch_up()
        if FaultKind.UNPLUG in self.world.faults_of(self.device):
            raise DeviceError(f"{self.place} is gone", remedy="plug it in again")
        return self._buffer.drain()

    def health(self) -> StreamHealth:
        """Return counts, age and rate."""
        self.world.catch_up()
        return self._buffer.health(lost_count=self._lost_count, corrupt_count=self._corrupt_count)

    def close(self) -> None:
        """Do nothing."""

    def _step(self, now_ns: int) -> None:
        if now_ns >= self._next_ns:
            self._next_ns += self._period_ns
            self._make(now_ns)

    @abstractmethod
    def _make(self, now_ns: int) -> None:
        """Make the sample that is due, unless it is lost."""


class MockForceSensor(_MockStream[ForceSample]):
    """Obeys ``drivers.interfaces.ForceTorqueSensor``.

    Faults it shows: stall, drop and garble (every tenth frame is lost), unplug, and the silent ones
    of a force sensor.
    """

    place = "force sensor: the port"
    model = "mock M3733C"
    device = Device.FORCE_SENSOR
    first_s = 0.02

    def __init__(self, world: MockWorld) -> None:
        super().__init__(world, rate_hz=world.config.force_sensor.rate)
        self._silent = SilentWrenchFaults(
            seed=world.config.emulation.seed, full_scale_n=world.config.force_sensor.capacity
        )

    @classmethod
    def from_config(cls, _config: RigConfig, arm: Any) -> Self:
        """Return a sensor in the world of the arm that carries it."""
        return cls(arm.world)

    def _make(self, now_ns: int) -> None:
        self._counter += 1
        faults = self.world.faults_of(self.device)
        if faults.keys() & {FaultKind.STALL, FaultKind.UNPLUG}:
            return
        if faults.keys() & {FaultKind.DROP, FaultKind.GARBLE} and self._counter % 10 == 0:
            self._lost_count += 1
            self._corrupt_count += 1
            return
        wrench = self._silent.reading(self.world.raw_wrench(), faults.values(), stamp_ns=now_ns)
        sample = ForceSample(stamp_ns=now_ns, counter=self._counter, wrench=wrench)
        self._buffer.push(sample, stamp_ns=now_ns, fingerprint=wrench)


class MockCamera(_MockStream[ImageFrame]):
    """Obeys ``drivers.interfaces.Camera``: small grey JPEGs, darker where the gel is touched.

    No two are the same bytes, as with a camera's noise. Faults it shows: stall, drop, unplug,
    saturate (every pixel is white), and the silent ones of a camera.
    """

    place = "camera: the device"
    model = "mock camera"
    device = Device.CAMERA
    first_s = 0.05
    settings: ClassVar[dict[str, str]] = {"width": str(WIDTH), "height": str(HEIGHT)}

    def __init__(self, world: MockWorld) -> None:
        super().__init__(world, rate_hz=world.config.camera.rate)
        self._white = _jpeg(255)
        self._silent = SilentImageFaults()

    @classmethod
    def from_config(cls, config: RigConfig) -> Self:
        """Return a camera in a world of its own on the host's clock, with its planned faults."""
        world = MockWorld(Clock(), config)
        camera = cls(world)
        world.plan(config.emulation.faults)
        return camera

    @property
    def _is_overexposed(self) -> bool:
        return FaultKind.SATURATE in self.world.faults_of(self.device)

    def health(self) -> StreamHealth:
        """Return counts, age and rate, and what is at full scale."""
        health = super().health()
        return replace(health, clipped_ratio=1.0) if self._is_overexposed else health

    def _make(self, now_ns: int) -> None:
        faults = self.world.faults_of(self.device)
        if faults.keys() & {FaultKind.STALL, FaultKind.DROP, FaultKind.UNPLUG}:
            self._lost_count += 1
            return
        self._counter += 1
        jpeg = self._silent.frame(_numbered(self._shown(), self._counter), faults.values())
        frame = ImageFrame(
            stamp_ns=now_ns,
            counter=self._counter,
            device_stamp_s=None,
            width=WIDTH,
            height=HEIGHT,
            jpeg=jpeg,
        )
        self._buffer.push(frame, stamp_ns=now_ns, fingerprint=jpeg)

    def _shown(self) -> bytes:
        depth_m = self.world.surface_z_m - self.world.pose.position[2]
        if self._is_overexposed:
            return self._white
        return _jpeg(128, spot_px=min(HEIGHT // 2, math.ceil(depth_m / _DEPTH_PER_PX_M)))


_DEPTH_PER_PX_M = 5e-5  # of the dark spot's radius
_SPOT_LEVEL = 64


@functools.cache
def _jpeg(level: int, *, spot_px: int = 0) -> bytes:
    image = np.full((HEIGHT, WIDTH, 3), level, dtype=np.uint8)
    if spot_px > 0:
        cv2.circle(image, (WIDTH // 2, HEIGHT // 2), spot_px, (_SPOT_LEVEL,) * 3, cv2.FILLED)
    return cv2.imencode(".jpg", image)[1].tobytes()


def _numbered(jpeg: bytes, number: int) -> bytes:
    """Return ``jpeg`` with a comment that no other frame has."""
    comment = number.to_bytes(8, "big")
    length = (len(comment) + 2).to_bytes(2, "big")
    return b"".join((jpeg[:2], b"\xff\xfe", length, comment, jpeg[2:]))
