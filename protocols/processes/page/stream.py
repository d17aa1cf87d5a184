"""One stream as a page shows it: how many a second, how many lost, how old."""

from __future__ import annotations

import time
from collections import deque
from typing import Any

WINDOW_NS = 2_000_000_000


class StreamView:
    """Counts what arrives of one stream.

    Attributes:
        numbers: The newest.
        picture: The newest; None where there is none.
        lost_count: Samples that their counter says were never seen.
    """

    def __init__(self) -> None:
        self.numbers: dict[str, Any] = {}
        self.picture: bytes | None = None
        self.newest_ns = 0
        self.lost_count = 0
        self._counter: int | None = None
        self._arrivals: deque[tuple[int, int]] = deque()

    def take(self, stamp_ns: int, *, count: int = 1, counters: tuple[int, ...] = ()) -> None:
        """Take in ``count`` samples, the newest of them stamped ``stamp_ns``."""
        self.newest_ns = stamp_ns
        self._arrivals.append((stamp_ns, count))
        while stamp_ns - self._arrivals[0][0] > WINDOW_NS:
            self._arrivals.popleft()
        for counter in counters:
            if self._counter is not None and counter > self._counter:
                self.lost_count += counter - self._counter - 1
            self._counter = counter

    def summary(self, now_ns: int) -> dict[str, float | None]:
        """Return rate [Hz], losses and age [s]."""
        return {
            "rate_hz": round(self._rate_hz(), 1),
            "lost": self.lost_count,
            "age_s": round((now_ns - self.newest_ns) * 1e-9, 3) if self.newest_ns else None,
        }

    def _rate_hz(self) -> float:
        recent = [one for one in self._arrivals if time.monotonic_ns() - one[0] < WINDOW_NS]
        if len(recent) < 2:
            return 0.0
        span_s = (recent[-1][0] - recent[0][0]) * 1e-9
        return sum(count for _, count in recent[1:]) / span_s if span_s > 0.0 else 0.0
