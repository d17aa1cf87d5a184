"""What a twin is to follow: always the newest of what came, and how much was left out."""

from __future__ import annotations

from collections import deque

from protocols.processes.feed import Shown
from sim.twin.frame import Goal
from tacauchy_rig.app.twin.wish import Follows

_PICTURES = 8


class Newest:
    """Takes what a run shows of force, arm and camera; who asks gets the newest.

    A depth is counted from the height at which the press begins, where the force gives the depth
    that is reached by then.

    Args:
        follows: What goals are made of.

    Attributes:
        dropped_count: Goals that a newer one took the place of.
    """

    def __init__(self, follows: Follows) -> None:
        self.dropped_count = 0
        self._follows = follows
        self._goal: Goal | None = None
        self._force_n = 0.0
        self._began: tuple[float, float] | None = None
        self._pictures: deque[tuple[int, bytes]] = deque(maxlen=_PICTURES)

    def take(self, shown: Shown) -> None:
        """Take what a feed shows."""
        if shown.stream == "camera" and shown.picture is not None:
            self._pictures.append((shown.stamp_ns, shown.picture))
        elif shown.stream == "force":
            self._force_n = float(shown.numbers["force_n"][-1])
            if self._follows is Follows.FORCE or self._began is None:
                self._put(Goal(stamp_s=shown.stamp_ns * 1e-9, force_n=self._force_n))
        elif shown.stream == "arm" and self._began is not None:
            height, depth = self._began
            sunk = depth + height - float(shown.numbers["position_m"][2])
            self._put(Goal(stamp_s=shown.stamp_ns * 1e-9, depth_m=max(0.0, sunk)))

    def begin_press(self, height_m: float, depth_m: float) -> None:
        """Count depths from a height of the tip at which so much is pressed in already [m]."""
        if self._follows is Follows.DEPTH:
            self._began = height_m, depth_m

    def end_press(self) -> None:
        """Follow the force until the next press begins."""
        self._began = None

    def goal(self) -> Goal | None:
        """Return the newest goal that was not asked for yet, and forget it."""
        found, self._goal = self._goal, None
        return found

    def picture(self, stamp_s: float) -> bytes | None:
        """Return the camera's frame that is nearest in time."""
        if not self._pictures:
            return None
        return min(self._pictures, key=lambda each: abs(each[0] * 1e-9 - stamp_s))[1]

    def pictures(self) -> list[bytes]:
        """Return the camera's last few frames, the oldest first."""
        return [picture for _, picture in self._pictures]

    def _put(self, goal: Goal) -> None:
        self.dropped_count += self._goal is not None
        self._goal = goal
