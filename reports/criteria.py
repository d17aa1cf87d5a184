"""What a trial must meet, with the remedy when it does not."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from reports.evidence import Thresholds, TrialEvidence
from reports.metrics import ImageScores, Metric
from tacauchy_rig.run import Criterion

REPLAY_AGAIN = "replay the run again; `tacauchy-rig replay RUN` keeps what was recorded"


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
    return Criterion(
        name="press",
        passed=passed,
        measured=float(passed),
        limit="the attempt ran to its end and met every check of the protocol",
        unit="",
        remedy="" if passed else remedy,
    )


def _force(trial: TrialEvidence, thresholds: Thresholds) -> Criterion:
    measured = None if trial.record is None else trial.record.force_measured_n
    mismatch = math.nan
    if measured is not None and trial.replay is not None:
        mismatch = trial.replay.force_simulated_n - measured
    limit = thresholds.max_force_mismatch_n
    return Criterion(
        name="force_mismatch",
        passed=abs(mismatch) <= limit,
        measured=mismatch,
        limit=f"|simulated - measured| at most {limit:g} N",
        unit="N",
        remedy=""
        if abs(mismatch) <= limit
        else f"tighten replay.force_tolerance, then {REPLAY_AGAIN}",
    )


def _similarity(thresholds: Thresholds, scores: ImageScores | None) -> Criterion:
    value = math.nan if scores is None else scores.ssim
    passed = value >= thresholds.ssim
    return Criterion(
        name="ssim",
        passed=passed,
        measured=value,
        limit=f"at least {thresholds.ssim:g} (RGB)",
        unit="",
        remedy=""
        if passed
        else "look at the difference images: a ring is pose, a tint is light, a disc is force;"
        " calibrate scale and optics for this sensor",
    )


def _discrimination(
    thresholds: Thresholds, discriminates: Mapping[str, bool]
) -> Iterator[Criterion]:
    if not thresholds.require_discrimination:
        return
    names = [m.value for m in Metric if m is not Metric.HISTOGRAM_CORRELATION]
    won = [name for name in names if discriminates.get(name, False)]
    passed = len(won) == len(names)
    yield Criterion(
        name="discrimination",
        passed=passed,
        measured=float(len(won)),
        limit=f"the right force beats every wrong one in {len(names)} of {len(names)} scores",
        unit="scores",
        remedy=""
        if passed
        else f"won in: {', '.join(won) or 'none'}; space the targets wider or calibrate optics",
    )
