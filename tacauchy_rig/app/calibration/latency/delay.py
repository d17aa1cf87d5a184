"""The delay of a signal that follows a known depth: what shift of the depth explains it best.

A spring-like contact gives a signal y that is a smooth function of the depth d of tau earlier, and
a gel that relaxes adds what it still remembers (a generalised Maxwell solid's branches):

    y(t) = a + b t + c d(t - tau) + e d(t - tau)^2 + sum_j w_j q_j(t - tau),
    dq_j/dt = dd/dt - q_j / T_j

For each tau the rest is linear least squares. Relaxation slower than 0.1 s is told from a delay by
two sines at once; a quicker one is counted as a delay, in the direction of an earlier signal.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from tacauchy_rig.core.arrays import BoolArray, FloatArray, Int64Array
from tacauchy_rig.core.errors import RecordError

GRID_S = 1e-3
"""Spacing of the depth's even time grid: well below any delay of interest."""
EARLIEST_S, LATEST_S, STEP_S = -0.06, 0.3, 0.005
BLOCKS = 6
"""Parts that are fitted by themselves: their scatter is the uncertainty, whatever the noise is."""
MIN_SAMPLES_A_BLOCK = 25
STALE_MADS, STALE_PASSES = 3.5, 5
"""A sample off by so many times the spread of all shows another moment: a camera that came too
late repeats an older image. The spread is the scaled median of the absolute residuals, and the
limit that of Iglewicz and Hoaglin 1993."""
MIN_EXPLAINED = 0.5
"""Part of a signal's variance; with less of it explained nothing was seen of the motion."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Delay:
    """How late a stream is.

    Attributes:
        delay_s: Later than the arm's state of the same moment; negative is earlier.
        uncertainty_s: Standard uncertainty, of the scatter between parts of the motion and of the
            depth's own times.
        explained: Part of the signal's variance that the shifted depth explains, where it is fresh.
        sample_count: Samples that were used.
        stale_count: Samples that were left out: they do not follow the motion.
    """

    delay_s: float
    uncertainty_s: float
    explained: float
    sample_count: int
    stale_count: int = 0


def find_delay(
    depth: tuple[FloatArray, FloatArray],
    signal: tuple[FloatArray, FloatArray],
    *,
    name: str,
    doubt_s: float = 0.0,
    relaxation_s: Sequence[float] = (),
) -> Delay:
    """Return how much later than the depth a signal is.

    Args:
        depth: Times [s] and depths [m] of the arm, each of shape [n].
        signal: Times [s] and values in any unit, each of shape [m].
        name: Of the signal, for errors.
        doubt_s: Standard uncertainty of the depth's own times [s].
        relaxation_s: Times of the branches that the gel may have [s].

    Raises:
        RecordError: Too few samples, or nothing of the motion in them.
    """
    path = _Path(depth, relaxation_s)
    time_s, value = signal
    inside = (time_s > path.start_s + LATEST_S) & (time_s < path.end_s + EARLIEST_S)
    time_s, value = time_s[inside], value[inside]
    if len(time_s) < BLOCKS * MIN_SAMPLES_A_BLOCK:
        raise RecordError(
            f"{name}: {len(time_s)} samples of a motion are too few to tell a delay",
            remedy="sway for longer: `tacauchy-rig calibrate latency --sway 20s`",
        )
    fresh = _fresh(path, time_s, value)
    stale_count = int(np.count_nonzero(~fresh))
    time_s, value = time_s[fresh], value[fresh]
    delay_s, left = _best(path, time_s, value)
    explained = 1.0 - left / max(float(np.var(value)) * len(value), 1e-300)
    if explained < MIN_EXPLAINED or not math.isfinite(explained):
        raise RecordError(
            f"{name}: the arm's motion explains {explained:.0%} of it, too little for a delay",
            remedy="press harder, or see whether the stream shows the contact at all",
        )
    parts = [
        _best(path, time_s[part], value[part])[0]
        for part in np.array_split(np.arange(len(time_s)), BLOCKS)
    ]
    scatter_s = float(np.std(parts, ddof=1)) / math.sqrt(BLOCKS)
    return Delay(
        delay_s=delay_s,
        uncertainty_s=math.hypot(scatter_s, doubt_s),
        explained=explained,
        sample_count=len(time_s),
        stale_count=stale_count,
    )


class _Path:
    """The depth and what the gel remembers of it, at any time."""

    def __init__(self, depth: tuple[FloatArray, FloatArray], relaxation_s: Sequence[float]) -> None:
        time_s, depth_m = depth
        self.start_s, self.end_s = float(time_s[0]), float(time_s[-1])
        self._grid_s = np.arange(self.start_s, self.end_s, GRID_S)
        even = np.interp(self._grid_s, time_s, depth_m)
        even = (even - even.mean()) / max(float(np.ptp(even)), 1e-12)
        rise = np.diff(even, prepend=even[0])
        remembered = [lfilter([1.0], [1.0, -math.exp(-GRID_S / T)], rise) for T in relaxation_s]
        self._columns = [even, even**2, *remembered]

    def terms(self, time_s: FloatArray) -> FloatArray:
        """Return what a signal is linear in, shape [n, terms], but for the delay."""
        shifted = [np.interp(time_s, self._grid_s, column) for column in self._columns]
        return np.column_stack(shifted)


def _fresh(path: _Path, time_s: FloatArray, value: FloatArray) -> BoolArray:
    """Return which samples show the moment that their stamps say, as the others do."""
    fresh = np.ones(len(value), dtype=bool)
    for _ in range(STALE_PASSES):
        delay_s, _ = _best(path, time_s[fresh], value[fresh])
        terms = _terms(path, time_s, delay_s)
        weights = np.linalg.lstsq(terms[fresh], value[fresh], rcond=None)[0]
        off = np.abs(value - terms @ weights)
        follows = off <= STALE_MADS * 1.4826 * float(np.median(off[fresh]))
        if np.array_equal(follows, fresh):
            break
        fresh = follows
    return fresh


def _terms(path: _Path, time_s: FloatArray, delay_s: float) -> FloatArray:
    """Return what a signal that is so much later is linear in, shape [n, terms]."""
    drift = (time_s - time_s.mean()) / max(float(np.ptp(time_s)), 1e-12)
    return np.column_stack([np.ones_like(drift), drift, path.terms(time_s - delay_s)])


def _best(path: _Path, time_s: FloatArray, value: FloatArray) -> tuple[float, float]:
    """Return the delay [s] that leaves least unexplained, and the sum of squares that it leaves."""

    def left(delay_s: float) -> float:
        terms = _terms(path, time_s, delay_s)
        weights = np.linalg.lstsq(terms, value, rcond=None)[0]
        return float(np.sum((value - terms @ weights) ** 2))

    tried = np.arange(EARLIEST_S, LATEST_S, STEP_S)
    first = float(tried[int(np.argmin([left(float(each)) for each in tried]))])
    found = minimize_scalar(left, bounds=(first - STEP_S, first + STEP_S), method="bounded")
    return float(found.x), float(found.fun)


def even_stamps(stamp_ns: Int64Array, counter: FloatArray, *, share: float = 0.5) -> FloatArray:
    """Return when samples of an even stream were stamped [s], without the jitter of single ones.

    A busy host reads late now and then: a line through the stamps over the counter, moved to their
    median, is when a sample is stamped as a rule.

    Args:
        stamp_ns: Of this host, shape [n].
        counter: The device's own count or clock, rising, shape [n].
        share: Of the stamps that are earlier than what is returned; 0.5 is the median.
    """
    seconds = (stamp_ns - stamp_ns[0]) * 1e-9
    line = np.polyfit(counter - counter[0], seconds, 1)
    even = np.polyval(line, counter - counter[0])
    return np.asarray(
        even + np.quantile(seconds - even, share) + stamp_ns[0] * 1e-9, dtype=np.float64
    )
