"""All mock devices on one mock world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from drivers.mock.arm import MockArm
from drivers.mock.camera import MockCamera
from drivers.mock.force_sensor import MockForceSensor
from drivers.mock.world import MockWorld


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
