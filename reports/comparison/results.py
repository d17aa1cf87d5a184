"""What a comparison found: plain values, the same names as in ``summary.json``."""

from __future__ import annotations

from dataclasses import dataclass, field

from reports.evidence.evidence import RunEvidence, TruthComparison
from reports.scores.contact import ContactScores
from reports.scores.correction import Corrections
from reports.scores.floors import Ceiling, Floors, Skill, WrongForceMatrix
from reports.scores.force_agreement import ForceAgreement
from reports.scores.force_margin import ForceMargin
from reports.scores.metrics import ImageScores, MeanInterval
from tacauchy_rig.core.run import Criterion


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamSummary:
    """Arrival of one stream's samples, measured from the recording.

    Attributes:
        rate_hz: Samples over the time they took.
        interval_p99_ms: 99th percentile of the time between arrivals [ms].
    """

    name: str
    nominal_rate_hz: float | None
    rate_hz: float
    sample_count: int
    lost_count: int | None
    interval_median_ms: float
    interval_p99_ms: float
    interval_max_ms: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialResult:
    """All numbers of one trial.

    Attributes:
        passed: Every criterion of ``criteria`` is met.
        outcome: How the accepted or last attempt ended; ``missing`` when there is none.
        metrics: The five scores on RGB; ``metrics_grey`` the same on luminance.
        skill: Per score, its place between the no-contact floor and the ceiling.
        discriminates: Per score, whether the right force beats every wrong one.
        force_margin: By how much it does so inside the contact, and how far that scatters.
    """

    index: int
    attempt: int
    outcome: str
    reason: str
    passed: bool
    force_target_n: float
    force_measured_n: float | None
    force_deviation_n: float | None
    force_drift_n: float | None
    force_simulated_n: float | None
    force_mismatch_n: float | None
    depth_measured_m: float | None
    depth_simulated_m: float | None
    force: ForceAgreement
    metrics: ImageScores | None
    metrics_grey: ImageScores | None
    floors: Floors | None
    ceiling: Ceiling | None
    skill: dict[str, Skill]
    discriminates: dict[str, bool]
    force_margin: ForceMargin | None
    contact: ContactScores | None
    contact_no_contact_residual: float | None
    corrections: Corrections | None
    criteria: tuple[Criterion, ...]
    rates: dict[str, float] = field(default_factory=dict)
    streams: tuple[StreamSummary, ...] = ()
    dwell_frame_count: int = 0
    replay: dict[str, object] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunStatistics:
    """Means over the trials with Student t intervals at 95 %.

    Attributes:
        metrics: Per score of the simulated images; ``no_contact`` the same of the floor.
        psnr_of_mean_mse_db: PSNR of the mean MSE; ``metrics["psnr_db"]`` is the mean of PSNRs.
        repeats_per_force: Fewest presses at any target force.
    """

    metrics: dict[str, MeanInterval]
    no_contact: dict[str, MeanInterval]
    psnr_of_mean_mse_db: float | None
    psnr_of_mean_mse_no_contact_db: float | None
    force_mismatch_n: MeanInterval
    prediction_error_relative: MeanInterval
    contact_zncc: MeanInterval
    contact_relative_residual: MeanInterval
    repeats_per_force: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ValidationReport:
    """A run, judged.

    Attributes:
        criteria: What the run as a whole must meet, beside its trials.
        verdict: A few plain sentences.
        abstract: The main result in one sentence.
        reading: What the scores can and cannot tell, sentence by sentence.
        limits: What this report does not show.
        evidence: What it was made from.
    """

    passed: bool
    criteria: tuple[Criterion, ...]
    verdict: str
    abstract: str
    reading: tuple[str, ...]
    limits: tuple[str, ...]
    trials: tuple[TrialResult, ...]
    statistics: RunStatistics
    matrices: tuple[WrongForceMatrix, ...]
    truth: tuple[TruthComparison, ...]
    evidence: RunEvidence
