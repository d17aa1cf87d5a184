"""Where the emulated force sensor's values come from."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from typing import Protocol

from drivers.emulators.plant.force_channel import ForceChannel
from drivers.emulators.plant.gel.gel import Plant
from drivers.emulators.shared_world import SharedWorld
from tacauchy_rig.run import Vector6


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatedForce:
    """What the emulated sensor reads and what is true at that moment.

    Attributes:
        reading: Fx, Fy, Fz [N], Mx, My, Mz [N m] with noise, drift and cross-talk.
        force_true_n: Pressing force without any of these [N].
        depth_true_m: Depth of the tip below the unloaded surface [m], negative above it; None
            where that means nothing: no gel, or the tip is beside it.
    """

    reading: Vector6
    force_true_n: float
    depth_true_m: float | None


class WrenchSource(Protocol):
    """Anything that knows the wrench at a moment."""

    def read(self, stamp_ns: int) -> EmulatedForce:
        """Return the force at ``stamp_ns`` of the monotonic clock."""
        ...


class ConstantSource:
    """A constant load with white noise, for a sensor that stands alone.

    Args:
        load: Fx, Fy, Fz [N], Mx, My, Mz [N m].
        noise_n: Standard deviation on each force [N]; a hundredth of it in N m on each moment.
    """

    def __init__(self, load: Vector6, *, noise_n: float, seed: int) -> None:
        self._load = load
        self._noise = (noise_n,) * 3 + (noise_n * 0.01,) * 3
        self._random = random.Random(seed)  # noqa: S311 - noise, not a secret

    def read(self, stamp_ns: int) -> EmulatedForce:  # noqa: ARG002 - constant in time
        """Return the load with fresh noise."""
        v = [a + self._random.gauss(0.0, s) for a, s in zip(self._load, self._noise, strict=True)]
        return EmulatedForce(
            reading=(v[0], v[1], v[2], v[3], v[4], v[5]),
            force_true_n=self._load[2],
            depth_true_m=None,
        )


class PlantSource:
    """The force on the indenter as the gel, the arm's pose and the sensor's electronics make it.

    Until an arm has published a pose, the sensor hangs free.
    """

    def __init__(self, plant: Plant, channel: ForceChannel, world: SharedWorld) -> None:
        self._plant = plant
        self._channel = channel
        self._world = world

    def read(self, stamp_ns: int) -> EmulatedForce:
        """Return the force for the newest pose of the arm."""
        state = self._world.read()
        pose = state.pose
        force, torque = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        depth = -math.inf
        if state.sequence > 0:
            force, torque = self._plant.wrench(pose, stamp_ns)
            depth = self._plant.depth(pose)
        return EmulatedForce(
            reading=self._channel.reading(force, torque, pose.rotation_vector, stamp_ns),
            force_true_n=force[2],
            depth_true_m=depth if math.isfinite(depth) else None,
        )
