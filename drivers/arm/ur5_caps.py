"""The last check of a motion before it leaves for the controller."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tacauchy_rig.errors import SafetyError
from tacauchy_rig.run import Vector6

_ROUNDING = 1.0 + 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionCaps:
    """Largest values that are ever sent.

    Attributes:
        speed: Of the tip [m/s].
        turn_speed: Of the tool [rad/s].
        acceleration: Of the tip [m/s^2].
    """

    speed: float
    turn_speed: float
    acceleration: float

    def require_line(self, device: str, target: Vector6, speed: float, acceleration: float) -> None:
        """Refuse a straight move that is too fast or leads nowhere.

        Raises:
            SafetyError: Beyond a cap, not positive, or not a number.
        """
        if not all(map(math.isfinite, target)):
            raise SafetyError(f"{device}: target {target} is not a pose")
        _require(device, "speed", speed * 1e3, self.speed * 1e3, "mm/s")
        _require(device, "acceleration", acceleration * 1e3, self.acceleration * 1e3, "mm/s^2")

    def require_velocity(self, device: str, velocity: Vector6, acceleration: float) -> None:
        """Refuse a velocity that is too fast.

        Raises:
            SafetyError: Beyond a cap, or not a number.
        """
        turn_speed = math.hypot(*velocity[3:])
        _require(device, "speed", math.hypot(*velocity[:3]) * 1e3, self.speed * 1e3, "mm/s")
        _require(device, "turning speed", turn_speed, self.turn_speed, "rad/s")
        _require(device, "acceleration", acceleration * 1e3, self.acceleration * 1e3, "mm/s^2")


def _require(device: str, name: str, asked: float, limit: float, unit: str) -> None:
    # Written so that a NaN is refused too.
    if not 0.0 <= asked <= limit * _ROUNDING:
        raise SafetyError(
            f"{device}: {name} {asked:g} {unit} is beyond the limit of {limit:g} {unit}",
            remedy="lower it, or raise the robot's limit in the configuration",
        )
