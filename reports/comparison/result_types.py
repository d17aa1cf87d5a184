"""What a comparison found."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from reports.comparison.report_criteria import COUNTS, COUNTS_OF_RUN, MARGIN
from reports.evidence.evidence_types import RunEvidence, StreamSummary, TruthComparison
from reports.scores.confidence_interval import MeanInterval
from reports.scores.contact_scores import ContactScores, Corrections
from reports.scores.force_uncertainty import ForceAgreement
from reports.scores.image_metrics import Ceiling, Floors, ImageScores, Skill
from reports.scores.wrong_forces import ForceMargin, WrongForceMatrix
from tacauchy_rig.core.run import Criterion


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialResult:
    """All numbers of one trial."""

    index: int
    attempt: int
    outcome: str  # how the accepted or last attempt ended; ``missing`` when there is none
    reason: str
    passed: bool  # every criterion of ``criteria`` is met
    force_target_n: float
    force_measured_n: float | None
    force_deviation_n: float | None
    force_drift_n: float | None
    force_simulated_n: float | None
    force_mismatch_n: float | None
    depth_measured_m: float | None
    depth_simulated_m: float | None
    force: ForceAgreement
    metrics: ImageScores | None  # on RGB; ``metrics_grey`` the same on luminance
    metrics_grey: ImageScores | None
    floors: Floors | None
    ceiling: Ceiling | None
    skill: dict[str, Skill]  # per score, its place between the no-contact floor and the ceiling
    # By how much the right force beats wrong ones inside the contact, and how far that scatters.
    force_margin: ForceMargin | None
    contact: ContactScores | None
    contact_no_contact_residual: float | None
    corrections: Corrections | None
    criteria: tuple[Criterion, ...]
    rates: dict[str, float] = field(default_factory=dict)
    streams: tuple[StreamSummary, ...] = ()
    replay: dict[str, object] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunStatistics:
    """Means over the trials with Student t intervals at 95 %."""

    # Per score of the simulated images; ``no_contact`` the same of the floor.
    metrics: dict[str, MeanInterval]
    no_contact: dict[str, MeanInterval]
    # PSNR of the mean MSE; ``metrics["psnr_db"]`` is the mean of PSNRs.
    psnr_of_mean_mse_db: float | None
    psnr_of_mean_mse_no_contact_db: float | None
    force_mismatch_n: MeanInterval
    prediction_error_relative: MeanInterval
    contact_zncc: MeanInterval
    contact_relative_residual: MeanInterval
    repeats_per_force: int  # fewest presses at any target force


@dataclass(frozen=True, slots=True, kw_only=True)
class ValidationReport:
    """A run, judged."""

    passed: bool
    criteria: tuple[Criterion, ...]  # what the run as a whole must meet, beside its trials
    verdict: str  # a few plain sentences
    abstract: str  # the main result in one sentence
    reading: tuple[str, ...]  # what the scores can and cannot tell, sentence by sentence
    limits: tuple[str, ...]  # what this report does not show
    trials: tuple[TrialResult, ...]
    statistics: RunStatistics
    matrices: tuple[WrongForceMatrix, ...]
    truth: tuple[TruthComparison, ...]
    evidence: RunEvidence  # what it was made from


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadlineRow:
    """One criterion over all trials."""

    name: str
    worst: float | None  # of the trials; None where one of them has no value
    unit: str
    limit: str
    met: int  # trials that met it, out of ``trials``
    trials: int

    @property
    def passed(self) -> bool:
        """Every trial met it."""
        return self.met == self.trials


def headline_of(
    trials: Sequence[TrialResult], run_criteria: Sequence[Criterion]
) -> tuple[HeadlineRow, ...]:
    """Return what counts: of the trials first, then of the run as a whole."""
    by_trial = [[c for t in trials for c in t.criteria if c.name == name] for name in COUNTS]
    of_run = [[c] for c in run_criteria if c.name in COUNTS_OF_RUN]
    return tuple(_row(found) for found in (*by_trial, *of_run) if found)


def worst_of(criteria: Sequence[Criterion]) -> Criterion:
    """Return the case of one criterion that is furthest off; one that has no value comes first."""
    return max(criteria, key=lambda criterion: badness(criterion.name, criterion.measured))


def badness(name: str, measured: float | None) -> float:
    """Return how far off a case of a criterion is; infinite where nothing is known of it."""
    if measured is None or math.isnan(measured):
        return math.inf
    return -measured if name == MARGIN else abs(measured)


def _row(criteria: Sequence[Criterion]) -> HeadlineRow:
    worst = worst_of(criteria)
    alike = len({c.limit for c in criteria}) == 1
    return HeadlineRow(
        name=worst.name,
        worst=None if math.isnan(worst.measured) else worst.measured,
        unit=worst.unit,
        limit=worst.limit if alike else f"{worst.limit} (of that trial)",
        met=sum(c.passed for c in criteria),
        trials=len(criteria),
    )
