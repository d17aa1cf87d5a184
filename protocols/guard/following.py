"""An arm that was given a velocity and does not move: stuck, or paused at the pendant.

Commanded travel (the velocity, integrated) is compared with the travel that the arm reports, over
a window that is at least ``limits.no_motion`` long and at least ``LEAST_TRAVEL_M`` of commanded
travel, so that it works at 0.5 mm/s and at 0.02 mm/s. Delays of a controller (below 0.1 s), its
acceleration (5 ms to 0.5 mm/s) and a speed slider at a third stay far from the limit.
"""

from __future__ import annotations

from collections import deque

from protocols.guard.breach import BreachError, Reaction

LEAST_TRAVEL_M = 50e-6
"""Commanded travel below which nothing is concluded: a servo at its target hardly moves."""
LEAST_SHARE = 0.25


class FollowGuard:
    """Compares commanded with measured travel along z.

    Args:
        window_s: Shortest time to compare over [s]; longer than any delay with which an arm may
            begin to move.
    """

    def __init__(self, *, window_s: float) -> None:
        self._window_ns = round(window_s * 1e9)
        self._speed_m_s = 0.0
        self._told_m = 0.0
        self._looked_ns: int | None = None
        self._past: deque[tuple[int, float, float]] = deque()

    def tell(self, speed_m_s: float) -> None:
        """Take the velocity along z that was commanded last [m/s]."""
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
            BreachError: It has covered less than a quarter of what was commanded.
        """
        if self._speed_m_s == 0.0:
            return
        if self._looked_ns is not None:
            self._told_m += self._speed_m_s * (now_ns - self._looked_ns) * 1e-9
        self._looked_ns = now_ns
        self._past.append((now_ns, self._told_m, z_m))
        while len(self._past) > 1 and self._is_enough(self._past[1], now_ns):
            self._past.popleft()
        if not self._is_enough(self._past[0], now_ns):
            return
        before_ns, told_before_m, z_before_m = self._past[0]
        told_m, gone_m = self._told_m - told_before_m, z_m - z_before_m
        if gone_m * told_m < LEAST_SHARE * told_m**2:
            raise _stalled(told_m, gone_m, duration_s=(now_ns - before_ns) * 1e-9)

    def _is_enough(self, since: tuple[int, float, float], now_ns: int) -> bool:
        since_ns, told_m, _ = since
        long_enough = now_ns - since_ns >= self._window_ns
        return long_enough and abs(self._told_m - told_m) > LEAST_TRAVEL_M


def _stalled(told_m: float, gone_m: float, *, duration_s: float) -> BreachError:
    way, sign = ("down", -1.0) if told_m < 0.0 else ("up", 1.0)
    measured_mm = round(sign * gone_m * 1e3, 3) + 0.0  # no "-0.000"
    return BreachError(
        f"robot: it does not follow: commanded {abs(told_m) * 1e3:.3f} mm {way} in "
        f"{duration_s:.1f} s, measured {measured_mm:.3f} mm",
        limit="limits.no_motion",
        reaction=Reaction.HOLD,
        remedy="see the pendant: a pause, the speed slider, or something in the way; then "
        "`tacauchy-rig resume` repeats this trial",
    )
