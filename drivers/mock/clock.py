"""A clock that advances only when someone sleeps: minutes of a run pass in milliseconds."""

from __future__ import annotations

STEP_NS = 1_000
"""Reading the clock costs a microsecond, so that a loop that forgets to sleep still ends."""


class SimulatedClock:
    """Nanoseconds since the start, moved on by ``sleep``."""

    def __init__(self, *, start_ns: int = 1_000_000_000) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        """Return the simulated time [ns]."""
        self._now_ns += STEP_NS
        return self._now_ns

    def sleep(self, duration_s: float) -> None:
        """Move the time on by ``duration_s`` [s]."""
        if duration_s > 0.0:
            self._now_ns += round(duration_s * 1e9)
