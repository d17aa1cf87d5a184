"""A stretch of force, its mean, deviation and slope."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from protocols.control.cycle import Cycle, Press


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceWindow:
    """Statistics of the pressing force over a window.

    Attributes:
        slope_n_s: Least-squares slope [N/s].
    """

    start_ns: int
    end_ns: int
    mean_n: float
    deviation_n: float
    slope_n_s: float


def summarise(presses: Sequence[Press]) -> ForceWindow:
    """Return the statistics of at least two samples.

    Raises:
        ValueError: Fewer than two samples.
    """
    if len(presses) < 2:
        raise ValueError(f"{len(presses)} force samples make no window")
    force = np.array([press.force_n for press in presses])
    stamps = np.array([press.stamp_ns - presses[0].stamp_ns for press in presses]) * 1e-9
    centred = stamps - stamps.mean()
    spread = float(centred @ centred)
    return ForceWindow(
        start_ns=presses[0].stamp_ns,
        end_ns=presses[-1].stamp_ns,
        mean_n=float(force.mean()),
        deviation_n=float(force.std(ddof=1)),
        slope_n_s=float(centred @ force) / spread if spread > 0.0 else 0.0,
    )


def listen(cycle: Cycle, duration_s: float) -> list[Press]:
    """Stand still for ``duration_s`` [s] and return what was felt.

    The last turn begins when it is over: what came while the computer was held up is not lost.
    """
    clock = cycle.rig.clock
    end_ns = clock.now_ns() + round(duration_s * 1e9)
    presses: list[Press] = []
    is_over = False
    while not is_over:
        is_over = clock.now_ns() >= end_ns
        presses += cycle.turn().presses
    return presses
