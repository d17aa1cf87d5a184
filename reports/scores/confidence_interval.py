"""Mean and confidence interval of a score over the trials."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True, kw_only=True)
class MeanInterval:
    """A mean over trials with its Student t interval."""

    mean: float | None  # None when no trial gave a finite value
    low: float | None  # lower end at ``CONFIDENCE``; None below two values
    high: float | None
    deviation: float | None  # sample standard deviation over the trials; None below two values
    count: int  # number of finite values


def t_interval(values: Sequence[float]) -> MeanInterval:
    """Compute the mean and its two-sided 95 % Student t interval over the finite values.

    A percentile bootstrap is not offered: with six values it covers 87 % instead of 95 %.
    """
    finite = np.array([v for v in values if math.isfinite(v)], dtype=np.float64)
    count = int(finite.size)
    mean = float(finite.mean()) if count else None
    if mean is None or count == 1:
        return MeanInterval(mean=mean, low=None, high=None, deviation=None, count=count)
    deviation = float(finite.std(ddof=1))
    half = student_t(count - 1) * deviation / math.sqrt(count)
    return MeanInterval(
        mean=mean, low=mean - half, high=mean + half, deviation=deviation, count=count
    )


def student_t(degrees_of_freedom: float) -> float:
    """Return how many standard deviations the half width of an interval at ``CONFIDENCE`` is."""
    from scipy.special import stdtrit  # noqa: PLC0415 - what draws needs none

    return float(stdtrit(degrees_of_freedom, 0.5 + CONFIDENCE / 2))
