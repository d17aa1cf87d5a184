"""An arm that was given a velocity and does not move: stuck, or paused at the pendant."""

from __future__ import annotations

from collections import deque

from protocols.breach import BreachError, Reaction

WINDOW_NS = 700_000_000
"""Longer than any delay with which an arm may begin to move."""
LEAST_TRAVEL_M = 50e-6
"""Told travel below which nothing is concluded: a servo at its target hardly moves."""
LEAST_SHARE = 0.25


class FollowGuard:
    """Compares the travel that the arm was told with the travel that it reports, along z."""

    def __init__(self) -> None:
        self._speed_m_s = 0.0
        self._told_m = 0.0
        self._looked_ns: int | None = None
        self._past: deque[tuple[int, float, float]] = deque()

    def tell(self, speed_m_s: float) -> None:
        """Take the velocity along z that the arm was told last [m/s]."""
        if speed_m_s * self._speed_m_s <= 0.0:
            self.forget()
        self._speed_m_s = speed_m_s

    def forget(self) -> None:
        """Begin anew: it was stopped, turned round, or goes a way of its own."""
        self._speed_m_s = 0.0
        self._looked_ns = None
        self._past.clear()

    def check(self, z_m: float, *, now_ns: int) -> None:
        """Judge the arm at height ``z_m``; once a turn.

        Raises:
            BreachError: It has covered less than a quarter of what it was told.
        """
        if self._speed_m_s == 0.0:
            return
        if self._looked_ns is not None:
            self._told_m += self._speed_m_s * (now_ns - self._looked_ns) * 1e-9
        self._looked_ns = now_ns
        self._past.append((now_ns, self._told_m, z_m))
        while len(self._past) > 1 and now_ns - self._past[1][0] >= WINDOW_NS:
            self._past.popleft()
        before_ns, told_before_m, z_before_m = self._past[0]
        if now_ns - before_ns < WINDOW_NS:
            return
        told_m, gone_m = self._told_m - told_before_m, z_m - z_before_m
        follows = gone_m * told_m >= LEAST_SHARE * told_m**2
        if abs(told_m) > LEAST_TRAVEL_M and not follows:
            raise BreachError(
                f"robot: it does not follow: told to go {abs(told_m) * 1e3:.3f} mm in "
                f"{(now_ns - before_ns) * 1e-9:.1f} s, it went {abs(gone_m) * 1e3:.3f} mm",
                limit="robot.follows",
                reaction=Reaction.HOLD,
                remedy="see the pendant: a pause, the speed slider, or something in the way",
            )
