"""Floors and ceiling of a score.

A score is informative only between its floor (no contact, a flat colour, a wrong force) and its
ceiling, which a repeat of the same press reaches.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from reports.evidence.evidence_types import TrialEvidence, TrialImages
from reports.scores.image_metrics import ImageScores, Metric, score
from tacauchy_rig.core.arrays import ImageArray

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
