"""The offset of two clocks that saw the same presses, found by when contact shows in both."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.signal import correlate, correlation_lags, lfilter

from tacauchy_rig.app.importing.presses import PressSpan, S, Samples, zero_of
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import FZ, CameraClock

FINER = 4
"""Steps of the search in an interval of the coarser signal."""
AROUND_S = 1.0
"""Before and after a press that its own offset is looked for in."""
NEAR_S, FAR_S = 0.3, 2.0
"""Beside the offset of the whole: so far that of a press is looked for, and where that is not far
enough, since one clock runs faster."""
NEAR_STEP_S = 0.002
BINS = 40
"""Of the first signal's values: so few that each has values of coming down and of letting go."""
LIKE = 0.6
"""Correlation of two signals of the same presses; less is of different ones."""
ALONE, APART_S = 0.97, 1.0
"""Of the best correlation: another offset, so far apart, has to have less."""
RATED = 3
"""Presses that tell whether one clock runs faster: two offsets always lie on a line."""
MEMORY_SHARE, MEMORY_S = 0.13, 0.2
"""Of a gel's force that fades after it was pressed, and how fast: more than gels of such sensors
are taken to, so that the truth lies between this and none."""
UNIFORM = 1.0 / math.sqrt(12.0)
"""Standard deviation of a uniform distribution of width 1."""
SMALL = (32, 24)
"""To which frames are scaled down to see when something changes [px]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Signal:
    """A measure of contact over time; times [s] ascending, shape [n], as the values."""

    time_s: FloatArray
    value: FloatArray

    def at(self, time_s: FloatArray) -> FloatArray:
        """Return the values at times; at its ends it goes on as it is there."""
        return np.interp(time_s, self.time_s, self.value)


def offset_to_force(
    force: Samples, seen: Signal, found: Sequence[PressSpan], *, height: Signal | None = None
) -> CameraClock:
    """Find what is to be added to times of images for those of the force.

    Its standard uncertainty is of the scatter between presses, the coarser interval, and how far
    apart what an image may follow lies.

    Args:
        seen: How far the images changed, in the camera's clock.
        height: Of the tip, which images follow; without, they follow a force between one that a
            gel's memory is taken off and one that it is not.

    Raises:
        RecordError: They do not show the same presses, or fit with several offsets.
    """
    felt = felt_over_rests(force, found)
    followed = [felt, without_memory(felt)]
    if height is not None:
        followed = [Signal(time_s=height.time_s, value=-height.value)]
    presses_s = [(start / S, end / S) for start, end in (each.pressed for each in found)]
    interval_s = float(np.median(np.diff(seen.time_s)))
    coarse_s = _coarse(root_of(felt), seen, interval_s / FINER)
    for within_s in (NEAR_S, FAR_S):
        offsets_s = np.array(
            [[_near(f, seen, press, coarse_s, within_s) for press in presses_s] for f in followed]
        )
        if np.abs(offsets_s - coarse_s).max() < 0.9 * within_s:
            break
    _check_rate(offsets_s.mean(axis=0), presses_s, interval_s)
    bounds_s, count = np.median(offsets_s, axis=1), len(presses_s)
    scatter_s = float(offsets_s.std(axis=1, ddof=1).max()) / math.sqrt(count) if count > 1 else 0.0
    single_s = interval_s if count == 1 else 0.0  # one press shows no scatter
    apart_s = UNIFORM * float(np.ptp(bounds_s))
    return CameraClock(
        offset_s=float(bounds_s.mean()),
        uncertainty_s=math.hypot(scatter_s, single_s, UNIFORM * interval_s, apart_s),
        correlation=likeness(root_of(felt), seen, float(bounds_s.mean())),
    )


def felt_over_rests(force: Samples, found: Sequence[PressSpan]) -> Signal:
    """Return how much is felt [N] over a zero that goes evenly from rest to rest."""
    rests = [each.rest for each in found]
    middles = [sum(rest) / 2.0 for rest in rests]
    zero = np.interp(force.stamp_ns, middles, [zero_of(force, rest) for rest in rests])
    return Signal(time_s=force.stamp_ns / S, value=np.abs(force.value[:, FZ] - zero))


def root_of(felt: Signal) -> Signal:
    """Return the root of a force: an image changes about as it does."""
    return Signal(time_s=felt.time_s, value=np.sqrt(felt.value))


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


def image_change(frames: Iterable[ImageArray], time_s: FloatArray) -> FloatArray:
    """Return how far each frame is from those of the first second [grey level].

    Args:
        time_s: Of each frame [s]; those that come late in a stream may be more than there are.
    """
    small = [
        cv2.resize(frame, SMALL, interpolation=cv2.INTER_AREA).astype(np.float64)
        for frame in frames
    ]
    if not small:
        return np.empty(0)
    stacked, times = np.stack(small), np.asarray(time_s)[: len(small)]
    rest = np.median(stacked[times <= times[0] + 1.0], axis=0)
    return np.asarray(np.sqrt(np.mean((stacked - rest) ** 2, axis=(1, 2, 3))))


def likeness(first: Signal, second: Signal, offset_s: float) -> float:
    """Return the correlation of two signals where both are, with an offset."""
    time_s = second.time_s + offset_s
    inside = (time_s >= first.time_s[0]) & (time_s <= first.time_s[-1])
    one, other = _standard(first.at(time_s[inside])), _standard(second.value[inside])
    return float(np.mean(one * other)) if inside.any() else 0.0


def _standard(values: FloatArray) -> FloatArray:
    return np.asarray((values - values.mean()) / (float(values.std()) or 1.0))


def _check_rate(
    offsets_s: FloatArray, presses_s: Sequence[tuple[float, float]], interval_s: float
) -> None:
    """Refuse clocks whose offset grows by two intervals, and by more than its scatter explains."""
    middle_s = np.mean(presses_s, axis=1)
    if len(middle_s) < RATED or not np.ptp(middle_s):
        return
    rate, offset_s = np.polyfit(middle_s, offsets_s, 1)
    left_s = float(np.std(offsets_s - offset_s - rate * middle_s))
    grown_s = float(rate) * float(np.ptp(middle_s))
    if abs(grown_s) > max(2.0 * interval_s, 3.0 * left_s):
        raise RecordError(
            f"the offset of the clocks grows by {grown_s:+.3f} s from the first press to the last: "
            f"the camera's advances by {1.0 - float(rate):.4f} s a second of the log's",
            remedy="frames were dropped, or their rate is wrong: on average there are "
            f"{(1.0 - float(rate)) / interval_s:.3f} a second; state that as data.frame_rate",
        )


def _coarse(first: Signal, second: Signal, step_s: float) -> float:
    """Return the offset of the largest correlation [s]."""
    grids = [np.arange(s.time_s[0], s.time_s[-1], step_s) for s in (first, second)]
    one, other = _standard(first.at(grids[0])), _standard(second.at(grids[1]))
    both = correlate(one, other, mode="full", method="fft") / min(len(one), len(other))
    lag_s = correlation_lags(len(one), len(other)) * step_s + grids[0][0] - grids[1][0]
    best = int(np.argmax(both))
    rival = float(both[np.abs(lag_s - lag_s[best]) > APART_S].max(initial=0.0))
    like = likeness(first, second, float(lag_s[best]))
    if like < LIKE or rival > ALONE * both[best]:
        raise RecordError(
            f"video and force log fit best with an offset of {lag_s[best]:.2f} s, where they are "
            f"correlated by {like:.2f}; another offset fits {100.0 * rival / both[best]:.0f} % "
            "as well",
            remedy=f"both have to show the same presses ({LIKE} at least), at uneven times",
        )
    return float(lag_s[best])


def _near(
    first: Signal, second: Signal, press_s: tuple[float, float], about_s: float, within_s: float
) -> float:
    """Return the offset of one press alone [s].

    It is the one with which the second signal is most nearly a function of the first: coming down
    and letting go then run along one curve, whatever its shape is.
    """
    grid = np.arange(press_s[0] - AROUND_S, press_s[1] + AROUND_S, NEAR_STEP_S)
    order = np.argsort(first.at(grid), kind="stable")
    offsets = about_s + np.arange(-within_s, within_s, NEAR_STEP_S)
    apart = [_scatter(second.at(grid - offset)[order]) for offset in offsets]
    return float(offsets[int(np.argmin(apart))])


def _scatter(values: FloatArray) -> float:
    """Return how far values are from their means in ``BINS`` bins of equal count."""
    begins = np.linspace(0, len(values), BINS, endpoint=False).astype(np.int64)
    counts = np.diff(begins, append=len(values))
    total, squares = (np.add.reduceat(each, begins) for each in (values, values**2))
    return float((squares - total**2 / counts).sum())
