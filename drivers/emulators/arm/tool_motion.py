"""Motion of an emulated arm's tip."""

import math

from tacauchy_rig.core.rotations import composed
from tacauchy_rig.core.run import Pose, Vector3, Vector6, vector6

STILL: Vector6 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_ARRIVED_M = 1e-9
# A turn without travel is driven as if its angle were travelled at this lever arm.
_LEVER_ARM_M = 0.5


class ToolMotion:
    """The tip's pose and velocity, advanced cycle by cycle, in Cartesian space only.

    Three ways to move exclude one another: along a line to a target, at a set velocity, and
    braking to a stop.
    """

    def __init__(self, home: Pose) -> None:
        self.pose: Vector6 = home.as_vector()  # x, y, z [m] and rotation vector [rad] of the tip
        self.velocity: Vector6 = STILL  # tool velocity [m/s, rad/s]
        # While True the arm stands still whatever it was told (an injected fault).
        self.stalled = False
        self._target: Vector6 | None = None
        self._target_velocity: Vector6 | None = None
        self._speed_cap = self._acceleration = self._speed = 0.0

    @property
    def is_still(self) -> bool:
        """True when nothing moves and nothing is meant to."""
        return self._target is None and self._target_velocity is None

    def move_to(self, target: Vector6, *, speed: float, acceleration: float) -> None:
        """Drive straight to ``target`` with a trapezoidal speed [m/s, m/s^2]."""
        self._target, self._target_velocity = target, None
        self._speed_cap, self._acceleration, self._speed = speed, acceleration, 0.0

    def set_velocity(self, velocity: Vector6, *, acceleration: float) -> None:
        """Approach ``velocity`` [m/s, rad/s] at ``acceleration`` [m/s^2, rad/s^2] and hold it."""
        self._target, self._target_velocity = None, velocity
        self._acceleration = acceleration

    def brake(self, deceleration: float) -> None:
        """Come to rest at ``deceleration`` [m/s^2]."""
        if not self.is_still:
            self.set_velocity(STILL, acceleration=deceleration)

    def step(self, duration_s: float) -> None:
        """Advance by ``duration_s`` [s]."""
        if self.is_still:
            return
        if self.stalled:
            self.velocity = STILL
            if self._target_velocity == STILL:
                self._target_velocity = None
        elif self._target is not None:
            self._approach(self._target, duration_s)
        elif self._target_velocity is not None:
            self._follow(self._target_velocity, duration_s)

    def _approach(self, target: Vector6, duration_s: float) -> None:
        x, y, z, a, b, c = self.pose
        turn: Vector3 = (0.0, 0.0, 0.0)
        if target[3:] != (a, b, c):
            turn = composed(target[3:], (-a, -b, -c))
        way = (target[0] - x, target[1] - y, target[2] - z, *turn)
        left = max(math.hypot(*way[:3]), _LEVER_ARM_M * math.hypot(*turn))
        braking = math.sqrt(2.0 * self._acceleration * left)
        new = min(self._speed + self._acceleration * duration_s, self._speed_cap, braking)
        step = 0.5 * (self._speed + new) * duration_s
        self._speed = new
        if step >= left - _ARRIVED_M:
            self.pose, self.velocity, self._target = target, STILL, None
            return
        self._travel(way, step / left)
        self.velocity = vector6(new / left * each for each in way)

    def _follow(self, target: Vector6, duration_s: float) -> None:
        v, limit = self.velocity, self._acceleration * duration_s
        change = [t - now for t, now in zip(target, v, strict=True)]
        sizes = (math.hypot(*change[:3]), math.hypot(*change[3:]))
        shares = [1.0 if size <= limit else limit / size for size in sizes for _ in range(3)]
        rows = zip(v, shares, change, strict=True)
        self.velocity = new = vector6(now + share * step for now, share, step in rows)
        # The mean of old and new velocity makes the travelled distance exact for a ramp.
        both = vector6(was + now for was, now in zip(v, new, strict=True))
        self._travel(both, 0.5 * duration_s)
        if target == STILL and not any(new):
            self._target_velocity = None

    def _travel(self, way: Vector6, share: float) -> None:
        """Go a share of a way [m, rad]."""
        x, y, z, a, b, c = self.pose
        dx, dy, dz, *turn = (share * each for each in way)
        rotation: Vector3 = (a, b, c)
        if any(turn):
            rotation = composed((turn[0], turn[1], turn[2]), rotation)
        self.pose = (x + dx, y + dy, z + dz, *rotation)
