"""What a score is worth: its floors, its ceiling, and whether it can tell forces apart.

A score says something only between the floor that no simulator should fall to (no contact at all,
a flat colour, a wrong force) and the ceiling that a repeat of the same press reaches.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from types import EllipsisType

import numpy as np

from reports.evidence.evidence import TrialEvidence, TrialImages
from reports.scores.contact import (
    contact_footprint,
    contact_region,
    image_change,
    relative_residual,
)
from reports.scores.metrics import ImageScores, Metric, score
from tacauchy_rig.core.arrays import BoolArray, ImageArray

NOISE_MULTIPLE = 3.0
CONTACT_RESIDUAL = "contact_relative_residual"

CrossScores = dict[int, dict[int, ImageScores]]


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
    """Scores of images that carry no information about this press.

    Attributes:
        no_contact: The real no-contact frame in place of the simulated image.
        flat_mean: One flat colour, the real image's own mean.
        wrong_force: Per score, the best that any other trial's simulated image reaches: the
            hardest of the wrong forces. None with a single trial.
    """

    no_contact: ImageScores
    flat_mean: ImageScores
    wrong_force: ImageScores | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Ceiling:
    """Scores that the real sensor reaches against itself."""

    kind: CeilingKind
    scores: ImageScores


@dataclass(frozen=True, slots=True, kw_only=True)
class Skill:
    """(score - floor) / (ceiling - floor); the floor is the no-contact frame.

    Attributes:
        value: None where there is no ceiling, or none that discriminates. Above 1 a noise-free
            image beats the sensor's own repeat, which says nothing about the simulator.
    """

    value: float | None
    status: SkillStatus


@dataclass(frozen=True, slots=True, kw_only=True)
class WrongForceMatrix:
    """One score of every real press (row) against every simulated press (column).

    Attributes:
        trials: Trial of each row and column.
        forces_n: Their target forces [N]; presses to one target are not wrong for one another.
        values: Shape [n, n]; NaN where a score does not exist, as between presses of other
            indenters or places.
        diagonal_wins: Per row, whether the own press scores better than every wrong force.
    """

    metric: str
    larger_is_better: bool
    trials: tuple[int, ...]
    forces_n: tuple[float, ...]
    values: tuple[tuple[float, ...], ...]
    diagonal_wins: tuple[bool, ...]


def flat_mean_image(image: ImageArray) -> ImageArray:
    """Return an image of one colour, the mean of ``image`` rounded to 8 bits."""
    mean = np.rint(image.reshape(-1, 3).mean(axis=0)).astype(np.uint8)
    return np.broadcast_to(mean, image.shape).copy()


def trial_floors(images: TrialImages, wrong: Sequence[ImageScores]) -> Floors:
    """Score the floors of one trial; ``wrong`` are the scores of wrong forces' simulated images."""
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


def press_over(
    images: TrialImages, other: TrialEvidence, region: BoolArray | EllipsisType = ...
) -> ImageArray | None:
    """Return what another trial's replay shows, over this trial's own no-contact frame.

    Light that drifted between the trials would otherwise tell them apart, and a score would
    seem to know the force.

    Args:
        images: Of this trial.
        other: The other one.
        region: Of the pixels that are wanted, shape [n, 3]; without, the whole image is returned.

    Returns:
        None when the other trial has no images.
    """
    if other.simulated_image is None or other.images is None:
        return None
    if other.images is images:
        return other.simulated_image[region]
    bare = other.images.reference[region].astype(np.int16)
    change = other.simulated_image[region].astype(np.int16) - bare
    return np.asarray(np.clip(images.reference[region] + change, 0, 255), dtype=np.uint8)


def cross_scores(trials: Sequence[TrialEvidence]) -> CrossScores:
    """Score every real press against the simulated ones of its kind, laid over its own frame.

    Returns:
        By the trial of the real image, then by that of the simulated one.
    """
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
    """Set every real press against every simulated one, for the five scores and the contact.

    Args:
        trials: Those without images, or alone of their kind, have neither row nor column.
        scores: Their ``cross_scores``.
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
    change = image_change(images.real, images.reference)
    footprint = contact_footprint(change)
    if footprint is None:
        return [math.nan] * len(candidates)
    region = contact_region(footprint)
    return [
        relative_residual(change, image_change(c, images.reference), region) for c in candidates
    ]


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
