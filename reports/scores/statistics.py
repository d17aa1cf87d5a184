"""What a handful of trials says about the mean, and how scores are averaged."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from reports.scores.metrics import psnr_of

CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True, kw_only=True)
class MeanInterval:
    """A mean over trials with its Student t interval.

    Attributes:
        mean: None when no trial gave a finite value.
        low: Lower end at ``CONFIDENCE``; None below two values.
        deviation: Sample standard deviation over the trials; None below two values.
        count: Number of finite values.
    """

    mean: float | None
    low: float | None
    high: float | None
    deviation: float | None
    count: int


def t_interval(values: Sequence[float]) -> MeanInterval:
    """Compute the mean and its two-sided 95 % Student t interval over the finite values.

    A percentile bootstrap is not offered: with six values it covers 87 % instead of 95 %.
    """
    finite = np.array([v for v in values if math.isfinite(v)], dtype=np.float64)
    count = int(finite.size)
    if count == 0:
        return MeanInterval(mean=None, low=None, high=None, deviation=None, count=0)
    mean = float(finite.mean())
    if count == 1:
        return MeanInterval(mean=mean, low=None, high=None, deviation=None, count=1)
    deviation = float(finite.std(ddof=1))
    half = float(stats.t.ppf(0.5 + CONFIDENCE / 2, count - 1)) * deviation / math.sqrt(count)
    return MeanInterval(
        mean=mean, low=mean - half, high=mean + half, deviation=deviation, count=count
    )


def psnr_of_mean_mse(mse_values: Sequence[float]) -> float:
    """Average through the error: PSNR [dB] of the mean of the MSEs [grey level^2].

    Never above the mean of the PSNRs, because the logarithm is concave in the error.
    """
    finite = [v for v in mse_values if math.isfinite(v)]
    return psnr_of(float(np.mean(finite))) if finite else math.nan
