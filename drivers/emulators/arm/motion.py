"""How the emulated arm moves its tip: straight lines, limited accelerations, finite stops.

The tip is moved in Cartesian space only; joints, singularities and dynamics are left out.
"""

from __future__ import annotations

import math

from tacauchy_rig.core.rotations import composed
from tacauchy_rig.core.run import Pose, Vector3, Vector6

_STILL: Vector6 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_ARRIVED_M = 1e-9
# A turn without travel is driven as if its angle were travelled at this lever arm.
_LEVER_ARM_M = 0.5


class ToolMotion:
    """The tip's pose and velocity, advanced cycle by cycle.

    Three ways to move exclude one another: along a line to a target, at a set velocity, and
    braking to a stop.

    Attributes:
        pose: x, y, z [m] and rotation vector [rad] of the tip.
        velocity: Tool velocity [m/s, rad/s].
        stalled: While True the arm stands still whatever it was told (an injected fault).
    """

    def __init__(self, home: Pose) -> None:
        self.pose: Vector6 = home.as_vector()
        self.velocity: Vector6 = _STILL
        self.stalled = False
        self._line: _Line | None = None
        self._target_velocity: Vector6 | None = None
        self._acceleration = 0.0

    @property
    def is_still(self) -> bool:
        """True when nothing moves and nothing is meant to."""
        return self._line is None and self._target_velocity is None

    def move_to(self, target: Vector6, *, speed: float, acceleration: float) -> None:
        """Drive straight to ``target`` with a trapezoidal speed [m/s, m/s^2]."""
        self._target_velocity = None
        self._line = _Line(self.pose, target, speed=speed, acceleration=acceleration)

    def set_velocity(self, velocity: Vector6, *, acceleration: float) -> None:
        """Approach ``velocity`` [m/s, rad/s] at ``acceleration`` [m/s^2, rad/s^2] and hold it."""
        self._line = None
        self._target_velocity = velocity
        self._acceleration = acceleration

    def be_at(self, pose: Vector6) -> None:
        """Take the tip to be at ``pose``; a straight move goes on to its target from there."""
        self.pose = pose
        if self._line is not None:
            self._line = self._line.restarted(pose)

    def brake(self, deceleration: float) -> None:
        """Come to rest at ``deceleration`` [m/s^2]."""
        if not self.is_still:
            self.set_velocity(_STILL, acceleration=deceleration)

    def step(self, duration_s: float) -> None:
        """Advance by ``duration_s`` [s]."""
        if self.is_still:
            return
        if self.stalled:
            self.velocity = _STILL
            if self._target_velocity == _STILL:
                self._target_velocity = None
        elif self._line is not None:
            self.pose, self.velocity = self._line.advance(duration_s)
            if self._line.arrived:
                self._line = None
                self.velocity = _STILL
        elif self._target_velocity is not None:
            self._follow(self._target_velocity, duration_s)

    def _follow(self, target: Vector6, duration_s: float) -> None:
        v = self.velocity
        dx, dy, dz, da, db, dc = (t - now for t, now in zip(target, v, strict=True))
        limit = self._acceleration * duration_s
        linear, angular = math.hypot(dx, dy, dz), math.hypot(da, db, dc)
        f = 1.0 if linear <= limit else limit / linear
        g = 1.0 if angular <= limit else limit / angular
        new = (
            v[0] + f * dx, v[1] + f * dy, v[2] + f * dz,
            v[3] + g * da, v[4] + g * db, v[5] + g * dc,
        )  # fmt: skip
        # The mean of old and new velocity makes the travelled distance exact for a ramp.
        half = 0.5 * duration_s
        x, y, z, *turn = self.pose
        rotation: Vector3 = (turn[0], turn[1], turn[2])
        if any(new[3:]) or any(v[3:]):
            step = (half * (v[3] + new[3]), half * (v[4] + new[4]), half * (v[5] + new[5]))
            rotation = composed(step, rotation)
        self.pose = (
            x + half * (v[0] + new[0]),
            y + half * (v[1] + new[1]),
            z + half * (v[2] + new[2]),
            *rotation,
        )
        self.velocity = new
        if target == _STILL and not any(new):
            self._target_velocity = None


class _Line:
    """A straight move with a trapezoidal speed, ending exactly at its target."""

    def __init__(
        self, start: Vector6, target: Vector6, *, speed: float, acceleration: float
    ) -> None:
        self._start, self._target = start, target
        self._speed, self._acceleration = speed, acceleration
        self._travel = (target[0] - start[0], target[1] - start[1], target[2] - start[2])
        inverse = (-start[3], -start[4], -start[5])
        self._turn = composed((target[3], target[4], target[5]), inverse)
        self._length = max(math.hypot(*self._travel), _LEVER_ARM_M * math.hypot(*self._turn))
        self._done_m = 0.0
        self._now = 0.0
        self.arrived = self._length < _ARRIVED_M

    def restarted(self, start: Vector6) -> _Line:
        """Return the move to the same target from elsewhere, begun at rest."""
        return _Line(start, self._target, speed=self._speed, acceleration=self._acceleration)

    def advance(self, duration_s: float) -> tuple[Vector6, Vector6]:
        """Return (pose, velocity) after another ``duration_s`` [s]."""
        left = self._length - self._done_m
        braking = math.sqrt(2.0 * self._acceleration * max(left, 0.0))
        new = min(self._now + self._acceleration * duration_s, self._speed, braking)
        step = 0.5 * (self._now + new) * duration_s
        self._now = new
        if self.arrived or step >= left - _ARRIVED_M:
            self.arrived = True
            return self._target, _STILL
        self._done_m += step
        share, rate = self._done_m / self._length, new / self._length
        s, d, t = self._start, self._travel, self._turn
        rotation = (s[3], s[4], s[5])
        if any(t):
            rotation = composed((share * t[0], share * t[1], share * t[2]), rotation)
        pose = (s[0] + share * d[0], s[1] + share * d[1], s[2] + share * d[2], *rotation)
        return pose, (
            rate * d[0], rate * d[1], rate * d[2], rate * t[0], rate * t[1], rate * t[2]
        )  # fmt: skip
