"""A mock camera: one small JPEG, again and again, at the configured rate."""

from __future__ import annotations

import math
from collections import deque
from typing import Self

import cv2
import numpy as np

from drivers.device.clock import HostClock
from drivers.device.interface import DeviceIdentity, StreamHealth
from drivers.mock.fault_plan import plan_faults
from drivers.mock.world import MockWorld
from tacauchy_rig.config.model import RigConfig
from tacauchy_rig.errors import DeviceError
from tacauchy_rig.run import ImageFrame

WIDTH, HEIGHT = 64, 48
FIRST_S = 0.05


class MockCamera:
    """Obeys ``drivers.camera.interface.Camera`` without a device.

    Faults it knows (in ``world.faults``): ``camera-silent``, ``camera-unplugged``,
    ``camera-overexposed`` (every pixel white).
    """

    def __init__(self, world: MockWorld) -> None:
        self.world = world
        self._period_ns = round(1e9 / world.config.camera.rate)
        self._next_ns = world.now_ns
        self._counter = 0
        self._lost_count = 0
        self._waiting: list[ImageFrame] = []
        self._stamps: deque[int] = deque(maxlen=50)
        self._grey, self._white = _plain_jpeg(128), _plain_jpeg(255)
        world.on_step(self._expose)

    @classmethod
    def from_config(cls, config: RigConfig) -> Self:
        """Return a camera in a world of its own on the host's clock, with its planned faults."""
        world = MockWorld(HostClock(), config)
        camera = cls(world)
        plan_faults(world, config.emulation.faults)
        return camera

    def connect(self) -> DeviceIdentity:
        """Answer once the first sample is there."""
        self.world.clock.sleep(FIRST_S)
        self.world.catch_up()
        return DeviceIdentity(
            driver="mock",
            address="in process",
            model="mock camera",
            serial="0",
            simulated=True,
            settings={"width": str(WIDTH), "height": str(HEIGHT)},
        )

    def drain(self) -> list[ImageFrame]:
        """Return the frames since the last call.

        Raises:
            DeviceError: It was unplugged.
        """
        self.world.catch_up()
        if "camera-unplugged" in self.world.faults:
            raise DeviceError("camera: the device is gone", remedy="plug it in again")
        frames, self._waiting = self._waiting, []
        return frames

    def health(self) -> StreamHealth:
        """Return counts, age and rate."""
        self.world.catch_up()
        stamps = self._stamps
        age_s = (self.world.clock.now_ns() - stamps[-1]) * 1e-9 if stamps else math.inf
        span_s = (stamps[-1] - stamps[0]) * 1e-9 if len(stamps) > 1 else 0.0
        return StreamHealth(
            received_count=self._counter,
            lost_count=self._lost_count,
            corrupt_count=0,
            repeat_count=0,
            age_s=age_s,
            rate_hz=(len(stamps) - 1) / span_s if span_s > 0.0 else 0.0,
            clipped_ratio=1.0 if self._is_overexposed else 0.0,
        )

    def close(self) -> None:
        """Do nothing."""

    @property
    def _is_overexposed(self) -> bool:
        return "camera-overexposed" in self.world.faults

    def _expose(self, now_ns: int) -> None:
        if now_ns < self._next_ns:
            return
        self._next_ns += self._period_ns
        if self.world.faults & {"camera-silent", "camera-unplugged"}:
            self._lost_count += 1
            return
        self._counter += 1
        self._stamps.append(now_ns)
        self._waiting.append(
            ImageFrame(
                stamp_ns=now_ns,
                counter=self._counter,
                device_stamp_s=None,
                width=WIDTH,
                height=HEIGHT,
                jpeg=self._white if self._is_overexposed else self._grey,
            )
        )


def _plain_jpeg(level: int) -> bytes:
    image = np.full((HEIGHT, WIDTH, 3), level, dtype=np.uint8)
    return cv2.imencode(".jpg", image)[1].tobytes()
