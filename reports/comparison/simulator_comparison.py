"""Simulators side by side: each one's outputs for a run's presses, scored as the run's own replay.

Floors and ceiling are those of the run's report, and so are the scores.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from reports.comparison.run_comparison import compare_images, image_means
from reports.evidence.evidence_types import RunEvidence, TrialEvidence
from reports.scores.confidence_interval import MeanInterval, t_interval
from reports.scores.contact_scores import ContactScores, Corrections, score_contact
from reports.scores.force_uncertainty import difference
from reports.scores.image_metrics import (
    CeilingKind,
    Floors,
    ImageScores,
    Metric,
    Skill,
    trial_ceiling,
    trial_floors,
)
from reports.scores.wrong_forces import ForceMargin, cross_scores, force_margins
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.simulated import Driven, Outputs, PressOutput, Simulator

OF_CONTACT = "contact_"
CORRECTED = f"{OF_CONTACT}residual_corrected"
WRONG = f"{OF_CONTACT}residual_of_rival"


@dataclass(frozen=True, slots=True)
class Score:
    """A column of the table."""

    key: str  # as ``means`` of a simulator has it
    label: str
    digits: int  # that are shown
    larger_is_better: bool | None  # None where the score is no error
    unit: str = ""
    factor: float = 1.0  # from SI to ``unit``

    @property
    def heading(self) -> str:
        """Label and unit."""
        return f"{self.label} ({self.unit})" if self.unit else self.label


FRAME = tuple(Score(m.value, m.heading, m.decimals, m.larger_is_better) for m in Metric)
"""Of the whole frame."""
CONTACT = (
    Score(f"{OF_CONTACT}relative_residual", "Contact residual", 3, False),
    Score(f"{OF_CONTACT}ring_residual", "Residual in a ring around it", 3, False),
    Score(WRONG, "Residual of the best wrong press", 3, None),
    Score(CORRECTED, "Residual without translation and light", 3, False),
    Score(f"{OF_CONTACT}zncc", "Contact ZNCC", 3, True),
    Score(f"{OF_CONTACT}error_levels", "Mean error inside", 2, False, "grey levels"),
    Score(f"{OF_CONTACT}ssim_crop", "SSIM around the contact", 3, True),
)
"""Of the contact alone."""
MECHANICS = (
    Score("force_error_relative", "Force error at the measured depth", 1, False, "%", 100.0),
    Score("depth_error_m", "Depth error at the measured force", 3, False, "mm", 1e3),
    Score("height_apart_rms_m", "Surface difference from our replay, rms", 1, None, "um", 1e6),
    Score("pressure_apart_relative", "Pressure difference from our replay", 1, None, "%", 100.0),
    Score("shear_apart_relative", "Shear difference from our replay", 1, None, "%", 100.0),
)
"""Of forces, surfaces, pressures and shear."""

ALL = (*FRAME, *CONTACT, *MECHANICS)


_NOTHING = PressOutput()
_SEEN = ("metrics", "skill", "contact", "corrections", "floors")
"""Of what a comparison of images finds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedPress:
    """One press of a simulator, scored."""

    index: int
    metrics: ImageScores | None
    skill: dict[str, Skill]
    contact: ContactScores | None
    corrections: Corrections | None
    margin: ForceMargin | None
    floors: Floors | None
    force_n: float | None
    force_error_n: float | None  # its force at the measured depth minus the measured one [N]
    force_error_relative: float | None
    depth_error_m: float | None  # its depth at the measured force minus the measured one [m]
    height_apart_rms_m: float | None = (
        None  # of its surface from our replay's, which is no truth [m]
    )
    height_apart_largest_m: float | None = None  # likewise the largest [m]
    # Of its pressure from our replay's, which is no truth either: the norm of the difference over
    # that of ours, of all pixels.
    pressure_apart_relative: float | None = None
    # Of its shear, likewise; 1 is what no shear at all would be.
    shear_apart_relative: float | None = None
    # Its pressure, summed over the image [N]: its own force, or they disagree.
    pressure_force_n: float | None = None

    @property
    def wins(self) -> bool | None:
        """Its image explains the contact better than its images of other presses and none at all.

        None where it has no image, or no contact shows.
        """
        if self.margin is None or math.isnan(self.margin.value):
            return None
        return self.margin.value > 0.0

    def value(self, key: str) -> float | None:
        """Return a score by its key; errors of force and depth without their sign."""
        if key == WRONG:
            if self.contact is None or self.margin is None:
                return None
            return self.contact.relative_residual + self.margin.value
        if key == CORRECTED:
            corrected = self.corrections and self.corrections.contact_pose_light_corrected
            return corrected.relative_residual if corrected else None
        if key.startswith(OF_CONTACT):
            name = key.removeprefix(OF_CONTACT)
            return None if self.contact is None else float(getattr(self.contact, name))
        if key in set(Metric):
            return None if self.metrics is None else float(getattr(self.metrics, key))
        found = getattr(self, key)
        return None if found is None else abs(found)


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedSimulator:
    """A simulator, scored."""

    outputs: Outputs  # what it gave
    is_ours: bool  # it is the run's own replay
    presses: tuple[JudgedPress, ...]  # one for each press of the run that it simulated
    # By score, over its presses; errors of force and depth without their sign.
    means: dict[str, MeanInterval]
    # In how many presses its own image beats its images of the others, and of how many.
    wins: tuple[int, int]

    @property
    def simulator(self) -> Simulator:
        """Who it is."""
        return self.outputs.simulator

    def image(self, trial: int) -> ImageArray | None:
        """Return what it shows of a trial."""
        return self.outputs.presses.get(trial, _NOTHING).image


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """What every simulator stands beside: a floor or the ceiling."""

    name: str
    means: dict[str, MeanInterval]  # as of a simulator


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """Simulators, judged by the presses of one run."""

    simulators: tuple[JudgedSimulator, ...]
    floors: tuple[Reference, ...]  # what says nothing of a press
    # What the sensor reaches against itself; None where the run does not tell.
    ceiling: Reference | None
    evidence: RunEvidence  # the run; its simulated images are our replay's


def judge(
    evidence: RunEvidence, others: Sequence[Outputs], *, ours: Outputs | None = None
) -> Judgement:
    """Score simulators' outputs for the presses of a run.

    Args:
        others: Their images have the scored size; their trials are the run's.
        ours: What its own replay gives; stands first.

    Raises:
        RecordError: Images of one trial differ in shape.
    """
    known = {} if ours is None else ours.presses
    entries = ([] if ours is None else [ours]) + list(others)
    return Judgement(
        simulators=tuple(_judged(evidence, e, known, is_ours=e is ours) for e in entries),
        floors=_floors(evidence),
        ceiling=_ceiling(evidence),
        evidence=evidence,
    )


def _judged(
    evidence: RunEvidence, entry: Outputs, ours: Mapping[int, PressOutput], *, is_ours: bool
) -> JudgedSimulator:
    trials = tuple(
        replace(trial, simulated_image=entry.presses.get(trial.index, _NOTHING).image)
        for trial in evidence.trials
    )
    shown = replace(evidence, trials=trials)
    margins = force_margins(trials)
    presses = []
    for trial in (each for each in trials if each.index in entry.presses):
        seen = compare_images(trial, shown, cross_scores([trial]))  # margins tell of other presses
        output = entry.presses[trial.index]
        presses.append(
            JudgedPress(
                index=trial.index,
                margin=margins.get(trial.index),
                force_n=output.force_n,
                **{name: seen[name] for name in _SEEN},
                **_force(trial, output, entry.simulator.driven_by),
                # Ours has the pressure of the measured force, and the force of the measured depth.
                **({} if is_ours else _fields(output, ours.get(trial.index, _NOTHING), evidence)),
            )
        )
    won = [press.wins for press in presses if press.wins is not None]
    return JudgedSimulator(
        outputs=entry,
        is_ours=is_ours,
        presses=tuple(presses),
        means=_means(presses),
        wins=(sum(won), len(won)),
    )


def _force(trial: TrialEvidence, output: PressOutput, driven: Driven | None) -> dict[str, Any]:
    """Return by how much the one of force and depth is off that the simulator was not told."""
    measured_n, is_told_depth = trial.force_measured_n, driven is Driven.DEPTH
    error_n = difference(output.force_n, measured_n) if is_told_depth else None
    off_m = difference(output.depth_m, trial.depth_measured_m)
    return {
        "force_error_n": error_n,
        "force_error_relative": error_n / measured_n
        if error_n is not None and measured_n
        else None,
        "depth_error_m": off_m if driven is Driven.FORCE else None,
    }


def _fields(output: PressOutput, ours: PressOutput, evidence: RunEvidence) -> dict[str, Any]:
    """Return what surface, pressure and shear say, by the fields of a press."""
    found: dict[str, Any] = {
        "pressure_apart_relative": _apart(output.pressure_pa, ours.pressure_pa),
        "shear_apart_relative": _apart(output.shear_pa, ours.shear_pa),
    }
    if output.height_m is not None and ours.height_m is not None:
        apart = output.height_m - ours.height_m
        found["height_apart_rms_m"] = float(np.sqrt(np.mean(apart**2)))
        found["height_apart_largest_m"] = float(np.abs(apart).max())
    x_m, y_m = evidence.geometry.scale_x_m_px, evidence.geometry.scale_y_m_px
    if output.pressure_pa is not None and x_m is not None and y_m is not None:
        found["pressure_force_n"] = float(output.pressure_pa.sum()) * x_m * y_m
    return found


def _apart(theirs: FloatArray | None, ours: FloatArray | None) -> float | None:
    """Return the norm of the difference over that of ours; None where ours is nothing."""
    if theirs is None or ours is None or not ours.any():
        return None
    return float(np.linalg.norm(theirs - ours) / np.linalg.norm(ours))


def _means(presses: Sequence[JudgedPress]) -> dict[str, MeanInterval]:
    found = {score.key: [press.value(score.key) for press in presses] for score in ALL}
    return {key: t_interval([v for v in values if v is not None]) for key, values in found.items()}


def _contact_means(contacts: Sequence[ContactScores]) -> dict[str, MeanInterval]:
    names = ("zncc", "relative_residual", "ring_residual", "error_levels", "ssim_crop")
    return {f"{OF_CONTACT}{n}": t_interval([getattr(c, n) for c in contacts]) for n in names}


def _floors(evidence: RunEvidence) -> tuple[Reference, ...]:
    """Return what a frame without contact and a flat colour score; neither knows the press."""
    seen = [trial.images for trial in evidence.trials if trial.images is not None]
    floors = [trial_floors(images, ()) for images in seen]
    untouched = [score_contact(images, images.reference) for images in seen]
    return (
        Reference(
            name="no-contact frame",
            means=image_means([floor.no_contact for floor in floors])
            | _contact_means([each for each in untouched if each is not None]),
        ),
        Reference(
            name="flat mean colour", means=image_means([floor.flat_mean for floor in floors])
        ),
    )


def _ceiling(evidence: RunEvidence) -> Reference | None:
    """Return what a repeat of each press scores, or else the two halves of its dwell."""
    ceilings = [
        ceiling
        for trial in evidence.trials
        if (ceiling := trial_ceiling(trial, [t for t in evidence.trials if t is not trial]))
    ]
    if not ceilings:
        return None
    halves = [
        score_contact(replace(trial.images, real=trial.images.first_half), trial.images.second_half)
        for trial in evidence.trials
        if trial.images is not None
        if trial.images.first_half is not None and trial.images.second_half is not None
    ]
    is_noise = all(ceiling.kind is CeilingKind.NOISE for ceiling in ceilings)
    return Reference(
        name="; ".join(sorted({ceiling.kind.value for ceiling in ceilings})),
        means=image_means([ceiling.scores for ceiling in ceilings])
        | (_contact_means([each for each in halves if each is not None]) if is_noise else {}),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Contest:
    """Ours against one other in one score."""

    other: str
    score: Score
    ours: float  # mean over the presses that both have, in the score's unit; ``theirs`` likewise
    theirs: float
    # Theirs minus ours, press by press, turned so that above zero ours is better; None where the
    # score is only of the means.
    difference: MeanInterval

    @property
    def is_lost(self) -> bool:
        """Ours is worse in the mean."""
        return self.difference.mean is not None and self.difference.mean < 0.0

    @property
    def is_clear(self) -> bool:
        """The 95 % interval of the difference does not hold zero."""
        low, high = self.difference.low, self.difference.high
        return low is not None and high is not None and (low > 0.0 or high < 0.0)


def contests(judgement: Judgement) -> tuple[Contest, ...]:
    """Set ours against every other in every score that both have."""
    ours = next((s for s in judgement.simulators if s.is_ours), None)
    if ours is None:
        return ()
    others = [s for s in judgement.simulators if s is not ours]
    return tuple(contest for other in others for contest in _against(ours, other))


def _against(ours: JudgedSimulator, other: JudgedSimulator) -> Iterator[Contest]:
    mine, theirs = ({press.index: press for press in one.presses} for one in (ours, other))
    shared = sorted(set(mine) & set(theirs))
    for each in (one for one in ALL if one.larger_is_better is not None):
        pairs = [(mine[i].value(each.key), theirs[i].value(each.key)) for i in shared]
        both = [(a, b) for a, b in pairs if a is not None and b is not None]
        sign = -1.0 if each.larger_is_better else 1.0
        first, second = (t_interval([pair[k] for pair in both]).mean for k in (0, 1))
        if first is not None and second is not None:
            yield Contest(
                other=other.simulator.title,
                score=each,
                ours=each.factor * first,
                theirs=each.factor * second,
                difference=t_interval([sign * each.factor * (b - a) for a, b in both]),
            )
