"""How two clocks lie to each other, from one event that both saw: when the gel was pressed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import correlate, correlation_lags, lfilter

from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import RecordError

FINER = 4
"""Steps of the search in an interval of the coarser signal."""
AROUND_S = 1.0
"""Before and after a press that its own offset is looked for in."""
NEAR_S = 0.3
"""Beside the offset of the whole: so far that of a press is looked for."""
NEAR_STEP_S = 0.002
BINS = 40
"""Of the first signal's values: so few that each has values of coming down and of letting go."""
LIKE = 0.6
"""Correlation of two signals of the same presses; less is of different ones."""
ALONE = 0.97
"""Of the best correlation: another offset, a press apart, has to have less."""
APART_S = 1.0
MEMORY_SHARE, MEMORY_S = 0.13, 0.2
"""Of a gel's force that fades after it was pressed, and how fast: more than gels of such sensors
are taken to, so that the truth lies between this and none."""
UNIFORM = 1.0 / math.sqrt(12.0)
"""Standard deviation of a uniform distribution of width 1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Signal:
    """What tells of contact over time; times [s] ascending, shape [n], as the values."""

    time_s: FloatArray
    value: FloatArray

    def at(self, time_s: FloatArray) -> FloatArray:
        """Return the values at times; at its ends it goes on as it is there."""
        return np.interp(time_s, self.time_s, self.value)


@dataclass(frozen=True, slots=True, kw_only=True)
class Offset:
    """What is to be added to times of the second clock for those of the first.

    Attributes:
        seconds: The offset [s].
        uncertainty_s: Standard uncertainty: scatter between presses, the coarser interval, and how
            far apart what the second may follow lies [s].
        correlation: Of both signals, with it [1].
    """

    seconds: float
    uncertainty_s: float
    correlation: float


def find_offset(
    first: Signal,
    second: Signal,
    presses_s: Sequence[tuple[float, float]],
    *,
    followed: Sequence[Signal] = (),
) -> Offset:
    """Find the offset with which two signals of the same presses fit best.

    Args:
        first: Of the clock that is kept; rises and falls as the second does.
        second: Of the clock that is to be moved.
        presses_s: Start and end of each press in the first clock [s].
        followed: What the second is a function of, in the first clock: one, or two that bound it;
            left out, it is ``first``.

    Raises:
        RecordError: They do not show the same presses, or fit with several offsets.
    """
    interval_s = float(np.median(np.diff(second.time_s)))
    coarse_s, likeness = _coarse(first, second, interval_s / FINER)
    found = np.array(
        [
            [_near(each, second, press, coarse_s) for press in presses_s]
            for each in followed or (first,)
        ]
    )
    bounds_s = np.median(found, axis=1)
    count = found.shape[1]
    scatter_s = float(found.std(axis=1, ddof=1).max()) / math.sqrt(count) if count > 1 else 0.0
    single_s = interval_s if count == 1 else 0.0  # one press shows no scatter
    apart_s = UNIFORM * float(np.ptp(bounds_s))
    return Offset(
        seconds=float(bounds_s.mean()),
        uncertainty_s=math.hypot(scatter_s, single_s, UNIFORM * interval_s, apart_s),
        correlation=likeness,
    )


def without_memory(force: Signal) -> Signal:
    """Return a force as of a gel that remembers, without what it remembers.

    A gel's force fades after it was pressed and its shape does not, so that coming down and letting
    go differ in force where they look alike. F = R + m with m' = -m / MEMORY_S + MEMORY_SHARE R',
    R the force that is left, sampled evenly.
    """
    step_s = float(np.median(np.diff(force.time_s)))
    time_s = np.arange(force.time_s[0], force.time_s[-1] + step_s, step_s)
    kept = math.exp(-step_s / MEMORY_S)
    new = MEMORY_SHARE * (1.0 - kept) * MEMORY_S / step_s
    left = lfilter([1.0, -kept], [1.0 + new, -(kept + new)], force.at(time_s))
    return Signal(time_s=time_s, value=np.asarray(left))


def _coarse(first: Signal, second: Signal, step_s: float) -> tuple[float, float]:
    """Return the offset of the largest correlation [s], and how large that is."""
    grids = [np.arange(s.time_s[0], s.time_s[-1], step_s) for s in (first, second)]
    one, other = (
        _standard(signal.at(grid)) for signal, grid in zip((first, second), grids, strict=True)
    )
    both = correlate(one, other, mode="full", method="fft") / min(len(one), len(other))
    lag_s = correlation_lags(len(one), len(other)) * step_s + grids[0][0] - grids[1][0]
    best = int(np.argmax(both))
    apart = np.abs(lag_s - lag_s[best]) > APART_S
    rival = float(both[apart].max(initial=0.0))
    if both[best] < LIKE or rival > ALONE * both[best]:
        raise RecordError(
            f"video and force log fit best with an offset of {lag_s[best]:.2f} s, where they are "
            f"correlated by {both[best]:.2f}; elsewhere by up to {rival:.2f}",
            remedy=f"both have to show the same presses ({LIKE} at least), at uneven times",
        )
    return float(lag_s[best]), float(both[best])


def _near(first: Signal, second: Signal, press_s: tuple[float, float], about_s: float) -> float:
    """Return the offset of one press alone [s].

    It is the one with which the second signal is most nearly a function of the first: coming down
    and letting go then run along one curve, whatever its shape is.
    """
    grid = np.arange(press_s[0] - AROUND_S, press_s[1] + AROUND_S, NEAR_STEP_S)
    order = np.argsort(first.at(grid), kind="stable")
    offsets = about_s + np.arange(-NEAR_S, NEAR_S, NEAR_STEP_S)
    apart = [_scatter(second.at(grid - offset)[order]) for offset in offsets]
    return float(offsets[int(np.argmin(apart))])


def _scatter(values: FloatArray) -> float:
    """Return how far values are from their means in ``BINS`` bins of equal count."""
    bins = np.array_split(values, BINS)
    return float(sum(((part - part.mean()) ** 2).sum() for part in bins))


def _standard(values: FloatArray) -> FloatArray:
    scatter = float(values.std())
    return np.asarray((values - values.mean()) / (scatter or 1.0))
