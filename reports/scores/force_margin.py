"""By how much a press's own simulated image beats those of wrong forces, and how far that scatters.

A margin without its scatter says nothing: with enough frames any two images differ. It is stated in
the residual inside the contact, which is 0 for a perfect image and 1 for one without any contact.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from reports.evidence.evidence import PressKey, TrialEvidence, TrialImages
from reports.scores.contact import contact_footprint, contact_region, image_change
from reports.scores.floors import press_over
from tacauchy_rig.core.arrays import BoolArray, FloatArray, ImageArray

MIN_REPEATS = 2  # presses to one force that have a scatter
PER_MEDIAN = 1.4826  # standard deviation over the median of the sizes, of normal noise


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceMargin:
    """How clearly a real press is told from wrong forces by its image.

    Attributes:
        value: Smallest residual that a wrong force or no contact leaves, minus that of the own
            force; negative where a wrong one wins. NaN where no contact shows.
        spread: How far ``value`` scatters for nothing but noise of the images or, where forces were
            pressed more than once and that is more, from press to press. None where neither is
            known.
        rival: What came second: a force, or no contact.
    """

    value: float
    spread: float | None
    rival: str

    @property
    def in_spreads(self) -> float:
        """The margin over its scatter; NaN where that is not known, but for one that is lost."""
        if not self.spread:
            return math.nan if self.value > 0.0 else self.value
        return self.value / self.spread


@dataclass(frozen=True, slots=True, kw_only=True)
class _Reading:
    """One trial's margin.

    Attributes:
        change: Between the margins of the two halves of the dwell; NaN without halves.
        sensitivity: Standard deviation of the margin for noise of one grey level that is the same
            everywhere and has no memory [1/grey level].
    """

    press_key: PressKey
    value: float
    rival: str
    change: float = math.nan
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
    repeated = _root_mean_square(_repeat_deviations(list(readings.values())))
    return {
        index: ForceMargin(
            value=r.value,
            spread=_largest(
                repeated,
                None if noise is None else noise * r.sensitivity,
                None if math.isnan(r.change) else abs(r.change),
            ),
            rival=r.rival,
        )
        for index, r in readings.items()
    }


def _read(
    images: TrialImages, own: ImageArray, trial: TrialEvidence, trials: Sequence[TrialEvidence]
) -> _Reading:
    change = image_change(images.real, images.reference)
    footprint = contact_footprint(change)
    if footprint is None:
        return _Reading(press_key=trial.press_key, value=math.nan, rival="")
    region = contact_region(footprint)

    bare = images.reference[region].astype(np.float64)

    def change_of(pixels: ImageArray) -> FloatArray:
        return (pixels.astype(np.float64) - bare).ravel()

    real, ours = change_of(images.real[region]), change_of(own[region])
    shown = _rivals(trial, images, trials, region)
    rivals = {name: change_of(pixels) for name, pixels in shown.items()}
    rival = min(rivals, key=lambda name: _residual(real, rivals[name]))
    theirs = rivals[rival]
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
) -> dict[str, ImageArray]:
    """Return pixels that must not explain a press as well as its own image's, by their name."""
    wrong = [t for t in trials if t.is_wrong_for(trial)]
    shown = {_named(t): press_over(images, t, region) for t in wrong}
    found = {name: image for name, image in shown.items() if image is not None}
    return {**found, "no contact": images.reference[region]}


def _named(trial: TrialEvidence) -> str:
    known = not math.isnan(trial.force_target_n)
    return f"{trial.force_target_n:g} N" if known else f"trial {trial.index}"


def _residual(real: FloatArray, simulated: FloatArray) -> float:
    return float(np.linalg.norm(real - simulated) / np.linalg.norm(real))


def _margin(real: FloatArray, ours: FloatArray, theirs: FloatArray) -> float:
    return _residual(real, theirs) - _residual(real, ours)


def _sensitivity(real: FloatArray, ours: FloatArray, theirs: FloatArray) -> float:
    """Return the norm of the margin's gradient with respect to the real change."""
    size = float(np.linalg.norm(real))

    def gradient(simulated: FloatArray) -> FloatArray:
        off = real - simulated
        length = float(np.linalg.norm(off))
        return np.asarray(off / (length * size) - real * (length / size**3)) if length else 0 * real

    return float(np.linalg.norm(gradient(theirs) - gradient(ours)))


def _repeat_deviations(readings: Sequence[_Reading]) -> list[float]:
    """Return the standard deviation of the margins of each force that was pressed repeatedly."""
    by_force: dict[PressKey, list[float]] = {}
    for reading in readings:
        by_force.setdefault(reading.press_key, []).append(reading.value)
    return [
        float(np.std(values, ddof=1)) for values in by_force.values() if len(values) >= MIN_REPEATS
    ]


def _deviation(values: Sequence[float]) -> float | None:
    """Return the standard deviation about zero, from the median so that one value hardly counts."""
    known = [abs(value) for value in values if math.isfinite(value)]
    return PER_MEDIAN * float(np.median(known)) if known else None


def _root_mean_square(values: Sequence[float]) -> float | None:
    known = [value for value in values if math.isfinite(value)]
    return math.sqrt(float(np.mean(np.square(known)))) if known else None


def _largest(*values: float | None) -> float | None:
    return max((value for value in values if value is not None), default=None)
