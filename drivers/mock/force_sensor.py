"""A mock force sensor: samples the mock world at its rate."""

from __future__ import annotations

import math
from collections import deque
from typing import Self

from drivers.device.interface import DeviceIdentity, StreamHealth
from drivers.mock.world import MockWorld, beside_no_mock
from tacauchy_rig.config.model import RigConfig
from tacauchy_rig.errors import DeviceError
from tacauchy_rig.run import ForceSample, Vector6, Wrench

FIRST_S = 0.02


class MockForceSensor:
    """Obeys ``drivers.force_sensor.interface.ForceTorqueSensor`` without a wire.

    Faults it knows (in ``world.faults``): ``force-silent``, ``force-stuck``, ``force-nan``,
    ``force-saturated``, ``force-lossy`` (every tenth frame is lost), ``force-unplugged``.
    """

    def __init__(self, world: MockWorld) -> None:
        self.world = world
        self._period_ns = round(1e9 / world.config.force_sensor.rate)
        self._next_ns = world.now_ns
        self._counter = 0
        self._waiting: list[ForceSample] = []
        self._stamps: deque[int] = deque(maxlen=100)
        self._received_count = 0
        self._lost_count = 0
        self._held: Vector6 | None = None
        world.on_step(self._sample)

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

    def connect(self) -> DeviceIdentity:
        """Answer once the first sample is there."""
        self.world.clock.sleep(FIRST_S)
        self.world.catch_up()
        return DeviceIdentity(
            driver="mock",
            address="in process",
            model="mock M3733C",
            serial="0",
            simulated=True,
            settings={},
        )

    def drain(self) -> list[ForceSample]:
        """Return the samples since the last call.

        Raises:
            DeviceError: It was unplugged.
        """
        self.world.catch_up()
        if "force-unplugged" in self.world.faults:
            raise DeviceError("force sensor: the port is gone", remedy="plug the adapter in again")
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
            corrupt_count=self._lost_count,
            repeat_count=0,
            age_s=age_s,
            rate_hz=(len(stamps) - 1) / span_s if span_s > 0.0 else 0.0,
        )

    def close(self) -> None:
        """Do nothing."""

    def _sample(self, now_ns: int) -> None:
        if now_ns < self._next_ns:
            return
        self._next_ns += self._period_ns
        self._counter += 1
        faults = self.world.faults
        if faults & {"force-silent", "force-unplugged"}:
            return
        if "force-lossy" in faults and self._counter % 10 == 0:
            self._lost_count += 1
            return
        wrench = self._wrench()
        self._held = wrench
        self._received_count += 1
        self._stamps.append(now_ns)
        self._waiting.append(
            ForceSample(
                stamp_ns=now_ns,
                counter=self._counter,
                wrench=Wrench(force=wrench[:3], torque=wrench[3:]),
            )
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
