"""Whether scores tell presses of different forces apart: an image against those at wrong forces."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import EllipsisType

import numpy as np

from reports.evidence.evidence_types import PressKey, TrialEvidence, TrialImages
from reports.scores.contact_scores import image_change, relative_residual, touched
from reports.scores.image_metrics import ImageScores, Metric, score
from tacauchy_rig.core.arrays import BoolArray, FloatArray, ImageArray

CONTACT_RESIDUAL = "contact_relative_residual"
CrossScores = dict[int, dict[int, ImageScores]]


@dataclass(frozen=True, slots=True, kw_only=True)
class WrongForceMatrix:
    """One score of every real press (row) against every simulated press (column)."""

    metric: str
    larger_is_better: bool
    trials: tuple[int, ...]  # trial of each row and column
    # Their target forces [N]; presses to one target are not wrong for one another.
    forces_n: tuple[float, ...]
    # Shape [n, n]; NaN where a score does not exist, as between presses of other indenters or
    # places.
    values: tuple[tuple[float, ...], ...]
    # Per row, whether the own press scores better than every wrong force.
    diagonal_wins: tuple[bool, ...]


def press_over(
    images: TrialImages, other: TrialEvidence, region: BoolArray | EllipsisType = ...
) -> ImageArray | None:
    """Return what another trial's replay shows, over this trial's own no-contact frame.

    Light that drifted between the trials would otherwise tell them apart, and a score would
    seem to know the force. With a region only its pixels are returned, shape [n, 3]; None when
    the other trial has no images.
    """
    if other.simulated_image is None or other.images is None:
        return None
    if other.images is images:
        return other.simulated_image[region]
    bare = other.images.reference[region].astype(np.int16)
    change = other.simulated_image[region].astype(np.int16) - bare
    return np.asarray(np.clip(images.reference[region] + change, 0, 255), dtype=np.uint8)


def cross_scores(trials: Sequence[TrialEvidence]) -> CrossScores:
    """Score every real press (first key) against the simulated ones of its kind, over its frame."""
    return {
        row.index: {
            column.index: score(row.images.real, image)
            for column in trials
            if column.kind == row.kind
            if (image := press_over(row.images, column)) is not None
        }
        for row in trials
        if row.images is not None
    }


def wrong_force_matrices(
    trials: Sequence[TrialEvidence], scores: CrossScores
) -> tuple[WrongForceMatrix, ...]:
    """Set every real press against every simulated one, for all scores and the contact.

    Trials without images, or alone of their kind, have neither row nor column.
    """
    shown = [t for t in trials if t.images is not None and t.simulated_image is not None]
    complete = [t for t in shown if any(other.is_wrong_for(t) for other in shown)]
    if not complete:
        return ()
    matrices = [
        _matrix(
            m.value,
            m.larger_is_better,
            complete,
            [[_score(scores, row, column, m) for column in complete] for row in complete],
        )
        for m in Metric
    ]
    residuals = []
    for row in complete:
        if row.images is not None:
            alike = [k for k, column in enumerate(complete) if column.kind == row.kind]
            over = [press_over(row.images, complete[k]) for k in alike]
            found = contact_residuals(row.images, [image for image in over if image is not None])
            values = np.full(len(complete), np.nan)
            values[alike] = found
            residuals.append(values.tolist())
    return (*matrices, _matrix(CONTACT_RESIDUAL, False, complete, residuals))


def _score(scores: CrossScores, row: TrialEvidence, column: TrialEvidence, metric: Metric) -> float:
    found = scores[row.index].get(column.index)
    return math.nan if found is None else found.value(metric)


def contact_residuals(images: TrialImages, candidates: Sequence[ImageArray]) -> list[float]:
    """Return the contact's relative residual of each candidate, NaN where no contact shows."""
    seen, bare = touched(images), images.reference
    if seen is None:
        return [math.nan] * len(candidates)
    change = image_change(images.real, bare)
    return [relative_residual(change, image_change(c, bare), seen.region) for c in candidates]


def _matrix(
    name: str, larger: bool, trials: Sequence[TrialEvidence], rows: Sequence[Sequence[float]]
) -> WrongForceMatrix:
    wrong = [[other.is_wrong_for(t) for other in trials] for t in trials]
    return WrongForceMatrix(
        metric=name,
        larger_is_better=larger,
        trials=tuple(t.index for t in trials),
        forces_n=tuple(t.force_target_n for t in trials),
        values=tuple(tuple(row) for row in rows),
        diagonal_wins=tuple(_wins(row, k, wrong[k], larger) for k, row in enumerate(rows)),
    )


def _wins(row: Sequence[float], position: int, wrong: Sequence[bool], larger: bool) -> bool:
    sign = 1.0 if larger else -1.0
    rivals = [v for v, is_wrong in zip(row, wrong, strict=True) if is_wrong]
    return all(sign * row[position] > sign * v for v in rivals if not math.isnan(v))


MIN_REPEATS = 2  # presses to one force that have a scatter

PER_MEDIAN = 1.4826  # standard deviation over the median of the sizes, of normal noise


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceMargin:
    """How clearly a real press is told from wrong forces by its image."""

    # Smallest residual that a wrong force or no contact leaves, minus that of the own force;
    # negative where a wrong one wins. NaN where no contact shows.
    value: float
    # How far ``value`` scatters for nothing but noise of the images or, where forces were pressed
    # more than once and that is more, from press to press. None where neither is known.
    spread: float | None
    rival: str  # what came second: a force, or no contact

    @property
    def in_spreads(self) -> float:
        """The margin over its scatter; NaN where that is not known, but for one that is lost."""
        if not self.spread:
            return math.nan if self.value > 0.0 else self.value
        return self.value / self.spread


@dataclass(frozen=True, slots=True, kw_only=True)
class _Reading:
    """One trial's margin."""

    press_key: PressKey
    value: float
    rival: str
    # Between the margins of the two halves of the dwell; NaN without halves.
    change: float = math.nan
    # Standard deviation of the margin for noise of one grey level that is the same everywhere and
    # has no memory [1/grey level].
    sensitivity: float = math.nan

    @property
    def noise(self) -> float:
        """Noise [grey level] that would change the margin as the halves do; NaN if none would."""
        return self.change / self.sensitivity if self.sensitivity > 0.0 else math.nan


def force_margins(trials: Sequence[TrialEvidence]) -> Mapping[int, ForceMargin]:
    """Return the margin of each trial that has images and a simulated image, by its index.

    A trial tells its own noise only once, by the two halves of its dwell. So all trials together
    tell how much noise there is, and each margin's sensitivity what it does there. The difference
    of two halves scatters by twice the variance of either, which covers the whole dwell (half of
    it) and the no-contact frame (of fewer frames). The median over the trials tells it, so that a
    dwell whose images changed blinds none of the others; its own halves count for itself.
    """
    readings = {
        trial.index: _read(trial.images, trial.simulated_image, trial, trials)
        for trial in trials
        if trial.images is not None and trial.simulated_image is not None
    }
    noise = _deviation([r.noise for r in readings.values()])
    repeated = _repeat_deviation(list(readings.values()))

    def spread(reading: _Reading) -> float | None:
        known = (repeated, noise * reading.sensitivity, abs(reading.change))
        return max((value for value in known if not math.isnan(value)), default=None)

    return {
        index: ForceMargin(value=r.value, spread=spread(r), rival=r.rival)
        for index, r in readings.items()
    }


def _read(
    images: TrialImages, own: ImageArray, trial: TrialEvidence, trials: Sequence[TrialEvidence]
) -> _Reading:
    seen = touched(images)
    if seen is None:
        return _Reading(press_key=trial.press_key, value=math.nan, rival="")
    region = seen.region
    bare = images.reference[region].astype(np.float64)

    def change_of(pixels: ImageArray) -> FloatArray:
        return (pixels.astype(np.float64) - bare).ravel()

    real, ours = change_of(images.real[region]), change_of(own[region])
    rivals = [(name, change_of(p)) for name, p in _rivals(trial, images, trials, region)]
    rival, theirs = min(rivals, key=lambda each: relative_residual(real, each[1]))
    first, second = (
        math.nan if half is None else _margin(change_of(half[region]), ours, theirs)
        for half in (images.first_half, images.second_half)
    )
    return _Reading(
        press_key=trial.press_key,
        value=_margin(real, ours, theirs),
        rival=rival,
        change=first - second,
        sensitivity=_sensitivity(real, ours, theirs),
    )


def _rivals(
    trial: TrialEvidence, images: TrialImages, trials: Sequence[TrialEvidence], region: BoolArray
) -> Iterator[tuple[str, ImageArray]]:
    """Yield pixels that must not explain a press as well as its own image's, and their name."""
    for other in trials:
        if other.is_wrong_for(trial) and (pixels := press_over(images, other, region)) is not None:
            yield _named(other), pixels
    yield "no contact", images.reference[region]


def _named(trial: TrialEvidence) -> str:
    known = not math.isnan(trial.force_target_n)
    return f"{trial.force_target_n:g} N" if known else f"trial {trial.index}"


def _margin(real: FloatArray, ours: FloatArray, theirs: FloatArray) -> float:
    return relative_residual(real, theirs) - relative_residual(real, ours)


def _sensitivity(real: FloatArray, ours: FloatArray, theirs: FloatArray) -> float:
    """Return the norm of the margin's gradient with respect to the real change."""
    size = float(np.linalg.norm(real))

    def gradient(simulated: FloatArray) -> FloatArray:
        off = real - simulated
        length = float(np.linalg.norm(off))
        return np.asarray(off / (length * size) - real * (length / size**3)) if length else 0 * real

    return float(np.linalg.norm(gradient(theirs) - gradient(ours)))


def _repeat_deviation(readings: Sequence[_Reading]) -> float:
    """Return the standard deviation of the margins of one force; NaN where none was repeated."""
    by_force: dict[PressKey, list[float]] = {}
    for reading in readings:
        by_force.setdefault(reading.press_key, []).append(reading.value)
    deviations = [np.std(each, ddof=1) for each in by_force.values() if len(each) >= MIN_REPEATS]
    known = [deviation for deviation in deviations if math.isfinite(deviation)]
    return math.sqrt(float(np.mean(np.square(known)))) if known else math.nan


def _deviation(values: Sequence[float]) -> float:
    """Return the standard deviation about zero, from the median so that one value hardly counts."""
    known = [abs(value) for value in values if math.isfinite(value)]
    return PER_MEDIAN * float(np.median(known)) if known else math.nan
