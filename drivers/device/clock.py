"""The one clock of a run: the host's monotonic clock, or a simulated one in mocks."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """What stamps everything that arrives."""

    def now_ns(self) -> int:
        """Return nanoseconds since an arbitrary start."""
        ...

    def sleep(self, duration_s: float) -> None:
        """Wait for ``duration_s`` [s]."""
        ...


class HostClock:
    """``time.monotonic_ns``; the same clock in every process of this host."""

    def now_ns(self) -> int:
        """Return nanoseconds of the host's monotonic clock."""
        return time.monotonic_ns()

    def sleep(self, duration_s: float) -> None:
        """Wait for ``duration_s`` [s]; nothing at or below zero."""
        if duration_s > 0.0:
            time.sleep(duration_s)
