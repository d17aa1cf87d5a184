"""Image scores, the paper's five, each defined once and named in full, with floors and ceiling.

All take 8-bit images, grey [height, width] or RGB [height, width, 3], and score the whole frame. A
score is informative only between its floor (no contact, a flat colour, a wrong force) and its
ceiling, which a repeat of the same press reaches.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from reports.evidence.evidence_types import TrialEvidence, TrialImages
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.errors import RecordError

HISTOGRAM_BINS = 256
SSIM_SIGMA_PX, SSIM_WINDOW_PX = 1.5, 11
SSIM_K1, SSIM_K2 = 0.01, 0.03
PEAK = 255.0


class Metric(StrEnum):
    """The scores, by the names they have in ``summary.json``."""

    label: str  # what a sentence calls it
    short: str  # what a figure calls it: a panel is narrow
    decimals: int  # how many a table shows
    unit: str  # empty for a plain number

    def __new__(cls, key: str, label: str, short: str, decimals: int, unit: str = "") -> Self:
        """Take a score's name in JSON as its value, the rest as attributes."""
        metric = str.__new__(cls, key)
        metric._value_ = key
        metric.label, metric.short, metric.decimals, metric.unit = label, short, decimals, unit
        return metric

    SSIM = "ssim", "SSIM", "SSIM", 4
    NCC = "ncc", "NCC", "NCC", 4
    HISTOGRAM_CORRELATION = "histogram_correlation", "histogram correlation", "Hist. corr.", 4
    PSNR_DB = "psnr_db", "PSNR", "PSNR", 2, "dB"
    MSE = "mse", "MSE", "MSE", 1, "grey level²"

    @property
    def heading(self) -> str:
        """Its name over a row of a table."""
        return self.label[0].upper() + self.label[1:]

    @property
    def panel_title(self) -> str:
        """Its short name and unit over a panel."""
        return f"{self.short} ({self.unit})" if self.unit else self.short

    @property
    def larger_is_better(self) -> bool:
        """False for errors."""
        return self is not Metric.MSE


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageScores:
    """The scores of one image against another."""

    ssim: float
    ncc: float  # NaN where one of the images is flat, because the correlation does not exist
    histogram_correlation: float
    psnr_db: float  # peak signal-to-noise ratio [dB]; infinite for identical images
    mse: float  # mean squared error [grey level^2]

    def value(self, metric: Metric) -> float:
        """Return the score that ``metric`` names."""
        return float(getattr(self, metric.value))


def structural_similarity_index(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> float:
    """Compute SSIM as defined by Wang et al., IEEE TIP 13(4), 2004, eq. 13; channels are averaged.

    A report compares every press with every other: OpenCV's filter takes a third of the time of
    SciPy's, at values that are the same to rounding.

    Raises:
        RecordError: The images differ in shape, are not 8-bit, or are smaller than the window.
    """
    check_image_pair(first, second)
    if min(first.shape[:2]) < SSIM_WINDOW_PX:
        raise RecordError(
            f"images of {first.shape[1]} x {first.shape[0]} px have no SSIM",
            remedy=f"its window is {SSIM_WINDOW_PX} px wide: score larger images",
        )
    x, y = np.atleast_3d(first), np.atleast_3d(second)
    return float(np.mean([_similarity(x[..., k], y[..., k]) for k in range(x.shape[2])]))


def _similarity(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> float:
    """Return the SSIM of one channel: all of it, but not of three, fits a processor's cache."""
    x, y = first.astype(np.float64), second.astype(np.float64)
    mean_x, mean_y = _windowed(x), _windowed(y)
    product, squares = mean_x * mean_y, mean_x * mean_x + mean_y * mean_y
    variances = _windowed(x * x + y * y) - squares
    covariance = _windowed(x * y) - product
    steady_mean, steady_variance = (SSIM_K1 * PEAK) ** 2, (SSIM_K2 * PEAK) ** 2
    likeness = (2.0 * product + steady_mean) * (2.0 * covariance + steady_variance)
    likeness /= (squares + steady_mean) * (variances + steady_variance)
    border = SSIM_WINDOW_PX // 2
    return float(likeness[border:-border, border:-border].mean())


def _windowed(values: FloatArray) -> FloatArray:
    """Return means in a Gaussian window."""
    size = (SSIM_WINDOW_PX, SSIM_WINDOW_PX)
    return np.asarray(cv2.GaussianBlur(values, size, SSIM_SIGMA_PX), np.float64)


def zero_mean_correlation(first: FloatArray, second: FloatArray) -> float:
    """Correlate two arrays of one shape after taking each one's mean off; NaN if one is flat."""
    a, b = first.ravel() - float(first.mean()), second.ravel() - float(second.mean())
    norm = math.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / norm if norm > 0.0 else math.nan


def histogram_correlation(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> float:
    """Correlate the 256-bin histograms, averaged over the channels."""
    pairs = [
        [
            cv2.calcHist([np.ascontiguousarray(image)], [channel], None, [HISTOGRAM_BINS], [0, 256])
            for image in (first, second)
        ]
        for channel in range(first.shape[2] if first.ndim == 3 else 1)
    ]
    return float(np.mean([cv2.compareHist(one, other, cv2.HISTCMP_CORREL) for one, other in pairs]))


def psnr_of(mse: float) -> float:
    """Convert a mean squared error [grey level^2] to a PSNR [dB]; infinite at zero."""
    return 10.0 * math.log10(PEAK**2 / mse) if mse > 0.0 else math.inf


def score(real: NDArray[np.uint8], simulated: NDArray[np.uint8]) -> ImageScores:
    """Compute all scores; both images RGB or both grey.

    Raises:
        RecordError: As for the SSIM.
    """
    ssim = structural_similarity_index(real, simulated)
    first, second = real.astype(np.float64), simulated.astype(np.float64)
    mse = float(np.mean((first - second) ** 2))
    return ImageScores(
        ssim=ssim,
        ncc=zero_mean_correlation(first, second),
        histogram_correlation=histogram_correlation(real, simulated),
        psnr_db=psnr_of(mse),
        mse=mse,
    )


def psnr_of_mean_mse(mse_values: Sequence[float]) -> float:
    """Average through the error: PSNR [dB] of the mean of the MSEs [grey level^2].

    Never above the mean of the PSNRs, because the logarithm is concave in the error.
    """
    finite = [v for v in mse_values if math.isfinite(v)]
    return psnr_of(float(np.mean(finite))) if finite else math.nan


def finite(value: float) -> float | None:
    """Return a value; None for one that is infinite or no number."""
    return value if math.isfinite(value) else None


def check_image_pair(first: ImageArray, second: ImageArray) -> None:
    """Check that two 8-bit images, grey or RGB, can be compared pixel by pixel.

    Raises:
        RecordError: Other type, other shape, or not an image.
    """
    for image in (first, second):
        is_image = image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 3)
        if image.dtype != np.uint8 or not is_image:
            raise RecordError(
                f"image of type {image.dtype} and shape {image.shape} cannot be scored",
                remedy="give 8-bit images of shape [height, width] or [height, width, 3]",
            )
    if first.shape != second.shape:
        raise RecordError(
            f"images of shape {first.shape} and {second.shape} cannot be compared",
            remedy="crop and resize both to the same size first",
        )


NOISE_MULTIPLE = 3.0


class CeilingKind(StrEnum):
    """Where the ceiling comes from; only a repeated press is a ceiling for a simulator."""

    NOISE = "noise: first against second half of the same dwell"
    REPEAT = "repeat: another press to the same target force"


class SkillStatus(StrEnum):
    """Whether a skill can be stated."""

    STATED = "stated"
    ABOVE_CEILING = "above the ceiling"
    NOT_DISCRIMINATING = "not discriminating"
    NO_CEILING = "no ceiling"


@dataclass(frozen=True, slots=True, kw_only=True)
class Floors:
    """Scores of images that carry no information about this press."""

    no_contact: ImageScores  # the real no-contact frame in place of the simulated image
    flat_mean: ImageScores  # one flat colour, the real image's own mean
    # Per score, the best that any other trial's simulated image reaches: the hardest of the wrong
    # forces. None with a single trial.
    wrong_force: ImageScores | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Ceiling:
    """Scores that the real sensor reaches against itself."""

    kind: CeilingKind
    scores: ImageScores


@dataclass(frozen=True, slots=True, kw_only=True)
class Skill:
    """(score - floor) / (ceiling - floor); the floor is the no-contact frame."""

    # None where there is no ceiling, or none that discriminates. Above 1 a noise-free image beats
    # the sensor's own repeat, which says nothing about the simulator.
    value: float | None
    status: SkillStatus


def flat_mean_image(image: ImageArray) -> ImageArray:
    """Return an image of one colour, the mean of ``image`` rounded to 8 bits."""
    mean = np.rint(image.reshape(-1, 3).mean(axis=0)).astype(np.uint8)
    return np.broadcast_to(mean, image.shape).copy()


def trial_floors(images: TrialImages, wrong: Sequence[ImageScores]) -> Floors:
    """Score the floors of one trial; ``wrong`` holds scores of images simulated at wrong forces."""
    return Floors(
        no_contact=score(images.real, images.reference),
        flat_mean=score(images.real, flat_mean_image(images.real)),
        wrong_force=_best_of(wrong),
    )


def _best_of(scores: Sequence[ImageScores]) -> ImageScores | None:
    if not scores:
        return None
    best: dict[str, float] = {}
    for metric in Metric:
        pick = max if metric.larger_is_better else min
        finite = [v for v in (s.value(metric) for s in scores) if not math.isnan(v)]
        best[metric.value] = pick(finite) if finite else math.nan
    return ImageScores(**best)


def trial_ceiling(trial: TrialEvidence, others: Sequence[TrialEvidence]) -> Ceiling | None:
    """Score a repeat of the same press, or else the two halves of its own dwell."""
    if trial.images is None:
        return None
    for other in others:
        if other.press_key == trial.press_key and other.images is not None:
            scores = score(trial.images.real, other.images.real)
            return Ceiling(kind=CeilingKind.REPEAT, scores=scores)
    first, second = trial.images.first_half, trial.images.second_half
    if first is None or second is None:
        return None
    return Ceiling(kind=CeilingKind.NOISE, scores=score(first, second))


def score_noise(images: TrialImages, simulated: ImageArray) -> dict[Metric, float] | None:
    """Estimate how much a score moves when only the camera's noise changes.

    Both the simulated image and the floor are scored against each half of the dwell; the larger
    of the two changes counts.
    """
    if images.first_half is None or images.second_half is None:
        return None
    changes = [
        (score(images.first_half, image), score(images.second_half, image))
        for image in (simulated, images.reference)
    ]
    return {m: max(abs(a.value(m) - b.value(m)) for a, b in changes) for m in Metric}


def skill(
    value: float,
    floor: float,
    ceiling: float | None,
    *,
    noise: float,
    larger_is_better: bool = True,
) -> Skill:
    """Place a score between floor and ceiling.

    Args:
        value: Score of the simulated image.
        floor: Score of the no-contact frame.
        ceiling: Score of the repeat; None when there is none.
        noise: Change of a score by noise alone; a span below three times it says nothing.
        larger_is_better: False for errors. A ceiling worse than the floor says nothing either.
    """
    if ceiling is None:
        return Skill(value=None, status=SkillStatus.NO_CEILING)
    span = ceiling - floor
    headroom = span if larger_is_better else -span
    known = math.isfinite(value) and math.isfinite(span) and math.isfinite(noise)
    if not known or headroom <= max(NOISE_MULTIPLE * noise, 1e-9):
        return Skill(value=None, status=SkillStatus.NOT_DISCRIMINATING)
    place = (value - floor) / span
    return Skill(
        value=place, status=SkillStatus.STATED if place <= 1.0 else SkillStatus.ABOVE_CEILING
    )
