"""Where the emulated force sensor's values come from."""

from __future__ import annotations

import random
from dataclasses import dataclass
from typing import Protocol

from tacauchy_rig.run import Vector6


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatedForce:
    """What the emulated sensor reads and what is true at that moment.

    Attributes:
        reading: Fx, Fy, Fz [N], Mx, My, Mz [N m] with noise, drift and cross-talk.
        force_true_n: Pressing force without any of these [N].
        depth_true_m: Depth of the tip below the unloaded surface [m].
    """

    reading: Vector6
    force_true_n: float
    depth_true_m: float


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
            depth_true_m=0.0,
        )
