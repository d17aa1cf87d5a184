"""What a trial must meet, with the remedy when it does not."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from reports.evidence.evidence import Thresholds, TrialEvidence
from reports.scores.metrics import ImageScores, Metric
from tacauchy_rig.run import Criterion

NOT_THERE = "press and replay this trial first: `tacauchy-rig resume RUN`, then `replay RUN`"


def judge_trial(
    trial: TrialEvidence,
    thresholds: Thresholds,
    *,
    scores: ImageScores | None,
    discriminates: Mapping[str, bool],
) -> tuple[Criterion, ...]:
    """Return every criterion of one trial; what is missing fails rather than disappears."""
    return (
        _protocol(trial),
        *trial.checks,
        _force(trial, thresholds),
        _similarity(thresholds, scores),
        *_discrimination(thresholds, discriminates),
    )


def _protocol(trial: TrialEvidence) -> Criterion:
    record = trial.record
    if record is None:
        remedy = "`tacauchy-rig resume RUN` goes on with the first trial that is missing"
    else:
        failed = [c for c in record.criteria if not c.passed]
        remedy = (
            " ".join([record.reason, *(f"{c.name}: {c.remedy or c.limit}" for c in failed)]).strip()
            or "`tacauchy-rig resume RUN` repeats the trial"
        )
    passed = record is not None and record.passed
    limit = "the attempt ran to its end and met every check of the protocol"
    return _criterion("press", float(passed), passed=passed, limit=limit, unit="", remedy=remedy)


def _force(trial: TrialEvidence, thresholds: Thresholds) -> Criterion:
    measured = None if trial.record is None else trial.record.force_measured_n
    mismatch = math.nan
    if measured is not None and trial.replay is not None:
        mismatch = trial.replay.force_simulated_n - measured
    limit = thresholds.max_force_mismatch_n
    return _criterion(
        "force_mismatch",
        mismatch,
        passed=abs(mismatch) <= limit,
        limit=f"|simulated - measured| at most {limit:g} N",
        unit="N",
        remedy=NOT_THERE
        if math.isnan(mismatch)
        else "lower replay.force_tolerance and replay the run: `tacauchy-rig replay RUN`",
    )


def _similarity(thresholds: Thresholds, scores: ImageScores | None) -> Criterion:
    value = math.nan if scores is None else scores.ssim
    return _criterion(
        "ssim",
        value,
        passed=value >= thresholds.ssim,
        limit=f"at least {thresholds.ssim:g} (RGB)",
        unit="",
        remedy=NOT_THERE
        if math.isnan(value)
        else "look at the difference images: a ring is pose, a tint is light, a disc is force;"
        " calibrate scale and optics for this sensor",
    )


def _criterion(
    name: str, measured: float, *, passed: bool, limit: str, unit: str, remedy: str
) -> Criterion:
    return Criterion(
        name=name,
        passed=passed,
        measured=measured,
        limit=limit,
        unit=unit,
        remedy="" if passed else remedy,
    )


def _discrimination(
    thresholds: Thresholds, discriminates: Mapping[str, bool]
) -> Iterator[Criterion]:
    if not thresholds.require_discrimination:
        return
    names = [m.value for m in Metric if m is not Metric.HISTOGRAM_CORRELATION]
    won = [name for name in names if discriminates.get(name, False)]
    yield _criterion(
        "discrimination",
        float(len(won)),
        passed=len(won) == len(names),
        limit=f"the right force beats every wrong one in {len(names)} of {len(names)} scores",
        unit="scores",
        remedy=f"won in: {', '.join(won) or 'none'}; space the targets wider or calibrate optics",
    )
