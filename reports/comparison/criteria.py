"""What a trial must meet, with the remedy when it does not."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from reports.evidence.evidence import RecordedForce, TrialEvidence
from tacauchy_rig.run import FZ, Criterion, Tare

RECORDED = RECORDED_FORCE, RECORDED_TARE, RECORDED_SIGN = (
    "recorded_force",
    "recorded_tare",
    "recorded_sign",
)
RECORDED_REMEDY = (
    "recording.mcap and result.json tell of different presses: one of them was edited, replaced or"
    " damaged. `tacauchy-rig recover RUN` repairs a damaged recording; else move the attempt's"
    " folder out of the run, and `tacauchy-rig resume RUN` presses the trial again"
)
STANDARD_ERRORS = 3.0
"""Of a mean: 99.7 % of the means of half of its samples lie within."""

ROUNDING_N = 1e-9
"""Samples and means are doubles on both sides: 1e4 samples of 1e3 N sum to 1e4 * 1e3 * 1e-16 N."""

NOT_THERE = "press and replay this trial first: `tacauchy-rig resume RUN`, then `replay RUN`"


def judge_record(trial: TrialEvidence) -> tuple[Criterion, ...]:
    """Return what the protocol and the recording say of a trial; what is missing fails."""
    return (_protocol(trial), *_recording(trial))


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
    return criterion("press", float(passed), passed=passed, limit=limit, unit="", remedy=remedy)


def _recording(trial: TrialEvidence) -> Iterator[Criterion]:
    """Hold tare, mean force and sign, computed again from the recording, against the protocol's.

    Both sides average the same raw samples between the same stamps, unfiltered, so on a whole
    recording they agree to rounding. One that lost up to half of them in a crash still has their
    mean to its standard error.
    """
    record, recorded = trial.record, trial.recorded
    tare = None if record is None else record.tare_before
    measured = None if record is None else record.force_measured_n
    if record is None or tare is None or measured is None or recorded is None:
        for name in RECORDED:
            limit = "the recording holds what the protocol measured"
            yield criterion(name, math.nan, passed=False, limit=limit, unit="N", remedy=NOT_THERE)
        return
    tare_errors_n = [_standard_error(d, tare.sample_count) for d in tare.deviation[:3]]
    force_error_n = math.hypot(
        _standard_error(record.force_deviation_n or 0.0, recorded.dwell_sample_count),
        tare_errors_n[FZ],
    )
    pressing, sign = recorded.compression_sign * recorded.rise_n, recorded.compression_sign
    limit_n = ROUNDING_N + STANDARD_ERRORS * force_error_n
    yield criterion(
        RECORDED_FORCE,
        pressing,
        passed=abs(pressing - measured) <= limit_n,
        limit=f"within {limit_n:.2g} N of {measured:.6g} N, the mean that the protocol measured",
        unit="N",
        remedy=RECORDED_REMEDY,
    )
    yield _recorded_tare(recorded, tare, tare_errors_n)
    yield criterion(
        RECORDED_SIGN,
        recorded.rise_n,
        passed=math.copysign(1.0, measured) * pressing > limit_n,
        limit=f"raw Fz moves to {'plus' if sign * measured > 0.0 else 'minus'} where the protocol"
        f" measured {measured:.6g} N with compression_sign {sign:+d}",
        unit="N",
        remedy=RECORDED_REMEDY,
    )


def _recorded_tare(
    recorded: RecordedForce, tare: Tare, standard_errors_n: Sequence[float]
) -> Criterion:
    """Judge the axis that is furthest off for its noise."""
    limits_n = [ROUNDING_N + STANDARD_ERRORS * error for error in standard_errors_n]
    off = [
        abs(again - said) / limit_n
        for again, said, limit_n in zip(recorded.tare_n, tare.mean, limits_n, strict=False)
    ]
    worst = max(range(3), key=lambda axis: math.inf if math.isnan(off[axis]) else off[axis])
    return criterion(
        RECORDED_TARE,
        recorded.tare_n[worst],
        passed=off[worst] <= 1.0,
        limit=f"within {limits_n[worst]:.2g} N of {tare.mean[worst]:.6g} N, the raw F{'xyz'[worst]}"
        " that the protocol took as zero",
        unit="N",
        remedy=RECORDED_REMEDY,
    )


def _standard_error(deviation: float, sample_count: int) -> float:
    return deviation / math.sqrt(max(sample_count, 1))


def criterion(
    name: str, measured: float, *, passed: bool, limit: str, unit: str, remedy: str
) -> Criterion:
    """Return a criterion; one that is met needs no remedy."""
    return Criterion(
        name=name,
        passed=passed,
        measured=measured,
        limit=limit,
        unit=unit,
        remedy="" if passed else remedy,
    )
