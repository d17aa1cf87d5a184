"""How long anything takes, the least of several times."""

from __future__ import annotations

import time
from collections.abc import Callable


def times_of(act: Callable[[], object], *, most: int, least: int, budget_s: float) -> list[float]:
    """Repeat something after once to warm up, and return how long each time took [s].

    Args:
        most: Repeats.
        least: Repeats that are made however long they take.
        budget_s: Begin no more once so much was spent [s].
    """
    act()
    times: list[float] = []
    while len(times) < most and (len(times) < least or sum(times) < budget_s):
        started = time.perf_counter()
        act()
        times.append(time.perf_counter() - started)
    return times
