"""All mock devices on one mock world, and a clock that advances only when someone sleeps."""

from dataclasses import dataclass
from typing import Self

from drivers.interfaces import Clock
from tests.mock.arm import MockArm
from tests.mock.streams import MockCamera, MockForceSensor
from tests.mock.world import MockWorld

STEP_NS = 1_000
"""Reading the clock costs a microsecond, so that a loop that forgets to sleep still ends."""


class SimulatedClock(Clock):
    """Nanoseconds since the start, moved on by ``sleep``."""

    def __init__(self, *, start_ns: int = 1_000_000_000) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        """Return the simulated time [ns]."""
        self._now_ns += STEP_NS
        return self._now_ns

    def sleep(self, duration_s: float) -> None:
        """Move the time on by ``duration_s`` [s]."""
        if duration_s > 0.0:
            self._now_ns += round(duration_s * 1e9)


@dataclass(frozen=True, slots=True, kw_only=True)
class MockBench:
    """A laboratory in memory; everything on it moves when its clock does."""

    world: MockWorld
    arm: MockArm
    force_sensor: MockForceSensor
    camera: MockCamera

    @classmethod
    def on(cls, world: MockWorld) -> Self:
        """Put an arm, a force sensor and a camera into ``world`` and connect them."""
        bench = cls(
            world=world,
            arm=MockArm(world),
            force_sensor=MockForceSensor(world),
            camera=MockCamera(world),
        )
        bench.force_sensor.connect()
        bench.camera.connect()
        bench.arm.connect()
        return bench
