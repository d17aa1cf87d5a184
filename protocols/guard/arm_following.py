"""Whether the arm follows the velocity it was given."""

from collections import deque

from protocols.guard.breach_reaction import BreachError, Reaction

LEAST_TRAVEL_M = 50e-6
"""Commanded travel below which nothing is concluded: a servo at its target hardly moves."""
LEAST_SHARE, MOST_SHARE = 0.25, 1.75
MOST_AHEAD_M = 100e-6
"""Beyond ``MOST_SHARE``: what an arm still goes of the velocity before, 1 mm/s for 100 ms."""


class FollowGuard:
    """Finds an arm that does not do the velocity it was given: stuck, paused, or too fast.

    Commanded and measured travel along z are compared over a window of at least ``window_s`` and
    ``LEAST_TRAVEL_M``, so that it works at 0.5 mm/s and at 0.02 mm/s. A controller's delay (below
    0.1 s), its acceleration and a speed slider at a third stay far from the limit. The window is
    longer than any delay with which an arm may begin to move.
    """

    def __init__(self, *, window_s: float) -> None:
        self._window_ns = round(window_s * 1e9)
        self._speed_m_s = 0.0
        self._commanded_m = 0.0
        self._looked_ns: int | None = None
        self._past: deque[tuple[int, float, float]] = deque()

    def command(self, speed_m_s: float) -> None:
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
        """Refuse, once a turn, an arm that goes far less or more than commanded."""
        if self._speed_m_s == 0.0:
            return
        if self._looked_ns is not None:
            self._commanded_m += self._speed_m_s * (now_ns - self._looked_ns) * 1e-9
        self._looked_ns = now_ns
        self._past.append((now_ns, self._commanded_m, z_m))
        while len(self._past) > 1 and self._is_enough(self._past[1], now_ns):
            self._past.popleft()
        before_ns, commanded_before_m, z_before_m = self._past[0]
        commanded_m, gone_m = self._commanded_m - commanded_before_m, z_m - z_before_m
        duration_s = (now_ns - before_ns) * 1e-9
        if abs(gone_m) > MOST_SHARE * abs(commanded_m) + MOST_AHEAD_M:
            raise BreachError(
                f"robot: it moves further than commanded: commanded {commanded_m * 1e3:+.3f} mm in "
                f"{duration_s:.1f} s, measured {gone_m * 1e3:+.3f} mm (up is positive)",
                limit="limits.overshoot",
                reaction=Reaction.RETRACT,
                remedy="see the pendant: whether another program moves the arm, and its speed and "
                "units",
            )
        if not self._is_enough(self._past[0], now_ns):
            return
        if gone_m * commanded_m < LEAST_SHARE * commanded_m**2:
            way, sign = ("down", -1.0) if commanded_m < 0.0 else ("up", 1.0)
            measured_mm = round(sign * gone_m * 1e3, 3) + 0.0  # no "-0.000"
            raise BreachError(
                f"robot: it does not follow: commanded {abs(commanded_m) * 1e3:.3f} mm {way} in "
                f"{duration_s:.1f} s, measured {measured_mm:.3f} mm",
                limit="limits.no_motion",
                reaction=Reaction.HOLD,
                remedy="see the pendant: a pause, the speed slider, or something in the way; then "
                "`tacauchy-rig resume` repeats this trial",
            )

    def _is_enough(self, since: tuple[int, float, float], now_ns: int) -> bool:
        since_ns, commanded_m, _ = since
        long_enough = now_ns - since_ns >= self._window_ns
        return long_enough and abs(self._commanded_m - commanded_m) > LEAST_TRAVEL_M
