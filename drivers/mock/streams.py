"""Mock force sensor and camera: samples made as the mock world steps."""

from __future__ import annotations

import functools
import math
from abc import ABC, abstractmethod
from collections import deque
from typing import ClassVar, Generic, Self, TypeVar

import cv2
import numpy as np

from drivers.device.faults import Device
from drivers.device.interface import DeviceIdentity, HostClock, StreamHealth
from drivers.device.lies import LyingImages, LyingWrench
from drivers.mock.world import MockWorld, beside_no_mock, plan_faults
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.run import ForceSample, ImageFrame, Vector6, Wrench

SampleT = TypeVar("SampleT")

WIDTH, HEIGHT = 64, 48


class _MockStream(ABC, Generic[SampleT]):
    """A ``StreamingDevice`` without a wire, at a rate [Hz] in the world's time."""

    place: ClassVar[str]
    model: ClassVar[str]
    unplugged: ClassVar[str]
    first_s: ClassVar[float]
    rate_window: ClassVar[int]
    content: ClassVar[str]
    settings: ClassVar[dict[str, str]] = {}

    def __init__(self, world: MockWorld, *, rate_hz: float) -> None:
        self.world = world
        self._period_ns = round(1e9 / rate_hz)
        self._next_ns = world.now_ns
        self._counter = 0
        self._received_count = 0
        self._lost_count = 0
        self._corrupt_count = 0
        self._repeat_count = 0
        self._content: object = None
        self._waiting: list[SampleT] = []
        self._stamps: deque[int] = deque(maxlen=self.rate_window)
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
        if self.unplugged in self.world.faults:
            raise DeviceError(f"{self.place} is gone", remedy="plug it in again")
        samples, self._waiting = self._waiting, []
        return samples

    def health(self) -> StreamHealth:
        """Return counts, age and rate."""
        self.world.catch_up()
        stamps = self._stamps
        age_s = (self.world.clock.now_ns() - stamps[-1]) * 1e-9 if stamps else math.inf
        span_s = (stamps[-1] - stamps[0]) * 1e-9 if len(stamps) > 1 else 0.0
        return StreamHealth(
            received_count=self._received_count,
            lost_count=self._lost_count,
            corrupt_count=self._corrupt_count,
            repeat_count=self._repeat_count,
            age_s=age_s,
            rate_hz=(len(stamps) - 1) / span_s if span_s > 0.0 else 0.0,
            clipped_ratio=self._clipped_ratio(),
        )

    def close(self) -> None:
        """Do nothing."""

    def _step(self, now_ns: int) -> None:
        if now_ns < self._next_ns:
            return
        self._next_ns += self._period_ns
        sample = self._sample(now_ns)
        if sample is not None:
            content = getattr(sample, self.content)
            self._repeat_count = self._repeat_count + 1 if content == self._content else 1
            self._content = content
            self._received_count += 1
            self._stamps.append(now_ns)
            self._waiting.append(sample)

    @abstractmethod
    def _sample(self, now_ns: int) -> SampleT | None:
        """Return the sample that is due, or None where it is lost."""

    def _clipped_ratio(self) -> float:
        return 0.0


class MockForceSensor(_MockStream[ForceSample]):
    """Obeys ``drivers.force_sensor.interface.ForceTorqueSensor``.

    Faults it knows (in ``world.faults``): ``force-silent``, ``force-stuck``, ``force-nan``,
    ``force-saturated``, ``force-lossy`` (every tenth frame is lost), ``force-unplugged``. It lies
    as ``world.lies`` has it.
    """

    place = "force sensor: the port"
    model = "mock M3733C"
    unplugged = "force-unplugged"
    first_s = 0.02
    rate_window = 100
    content = "wrench"

    def __init__(self, world: MockWorld) -> None:
        super().__init__(world, rate_hz=world.config.force_sensor.rate)
        self._held: Vector6 | None = None
        self._lies = LyingWrench(
            seed=world.config.emulation.seed, full_scale_n=world.config.force_sensor.capacity
        )

    @classmethod
    def from_config(cls, config: RigConfig, arm: object = None) -> Self:
        """Return a sensor in the world of the arm that carries it.

        Raises:
            ConfigError: The arm is no mock.
        """
        world = getattr(arm, "world", None)
        if not isinstance(world, MockWorld):
            raise beside_no_mock(config)
        return cls(world)

    def _sample(self, now_ns: int) -> ForceSample | None:
        self._counter += 1
        faults = self.world.faults
        if faults & {"force-silent", "force-unplugged"}:
            return None
        if "force-lossy" in faults and self._counter % 10 == 0:
            self._lost_count += 1
            self._corrupt_count += 1
            return None
        lies = self.world.lies_of(Device.FORCE_SENSOR)
        self._held = self._wrench()
        wrench = self._lies.reading(self._held, lies, stamp_ns=now_ns)
        return ForceSample(
            stamp_ns=now_ns,
            counter=self._counter,
            wrench=Wrench(force=wrench[:3], torque=wrench[3:]),
        )

    def _wrench(self) -> Vector6:
        faults = self.world.faults
        if "force-stuck" in faults and self._held is not None:
            return self._held
        wrench = self.world.raw_wrench()
        if "force-nan" in faults:
            return (wrench[0], wrench[1], math.nan, *wrench[3:])
        if "force-saturated" in faults:
            return (self.world.config.force_sensor.capacity, *wrench[1:])
        return wrench


class MockCamera(_MockStream[ImageFrame]):
    """Obeys ``drivers.camera.interface.Camera``: small grey JPEGs, darker where the gel is touched.

    No two are the same bytes, as with a camera's noise. Faults it knows (in ``world.faults``):
    ``camera-silent``, ``camera-unplugged``, ``camera-overexposed`` (every pixel white). It lies as
    ``world.lies`` has it.
    """

    place = "camera: the device"
    model = "mock camera"
    unplugged = "camera-unplugged"
    first_s = 0.05
    rate_window = 50
    content = "jpeg"
    settings: ClassVar[dict[str, str]] = {"width": str(WIDTH), "height": str(HEIGHT)}

    def __init__(self, world: MockWorld) -> None:
        super().__init__(world, rate_hz=world.config.camera.rate)
        self._white = _jpeg(255)
        self._lies = LyingImages()

    @classmethod
    def from_config(cls, config: RigConfig) -> Self:
        """Return a camera in a world of its own on the host's clock, with its planned faults."""
        world = MockWorld(HostClock(), config)
        camera = cls(world)
        plan_faults(world, config.emulation.faults)
        return camera

    @property
    def _is_overexposed(self) -> bool:
        return "camera-overexposed" in self.world.faults

    def _clipped_ratio(self) -> float:
        return 1.0 if self._is_overexposed else 0.0

    def _sample(self, now_ns: int) -> ImageFrame | None:
        if self.world.faults & {"camera-silent", "camera-unplugged"}:
            self._lost_count += 1
            return None
        self._counter += 1
        lies = self.world.lies_of(Device.CAMERA)
        return ImageFrame(
            stamp_ns=now_ns,
            counter=self._counter,
            device_stamp_s=None,
            width=WIDTH,
            height=HEIGHT,
            jpeg=self._lies.frame(_numbered(self._shown(), self._counter), lies),
        )

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
