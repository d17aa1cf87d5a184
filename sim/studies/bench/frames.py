"""Twenty frames of a travel of 1 mm into a gel, and how long anything takes."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

TRAVEL_M = 1e-3
FRAME_COUNT = 20
FORCE_ERROR_MAX = 0.03


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedFrames(ABC):
    """A travel in frames on one mesh, in one environment or many side by side.

    Attributes:
        wall_s: All frames of all environments, the least of several [s].
        force_error: F_z of the last frame in the first environment over that of preset accurate,
            less one.
    """

    tet_count: int
    unknown_count: int
    wall_s: float = float("nan")
    force_error: float = float("nan")

    @property
    def frame_ms(self) -> float:
        """Time of a frame of all environments [ms]."""
        return 1e3 * self.wall_s / FRAME_COUNT

    @property
    def frames_per_s(self) -> float:
        """Frames of all environments together [1/s]."""
        return FRAME_COUNT * self._travelling / self.wall_s

    @property
    @abstractmethod
    def _travelling(self) -> int:
        """Environments whose frames count."""


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
