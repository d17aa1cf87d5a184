"""What was measured of a press, computed again from the raw samples of its recording."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from tacauchy_rig.core.arrays import FloatArray, Int64Array
from tacauchy_rig.core.run import FZ, Criterion, JournalEvent, Tare, TrialRecord
from tacauchy_rig.core.store.check.attempt import RECOVER, Attempt, within

Z = 2  # of a position
_MM = 1e3  # in a metre; depths are read in millimetres

STANDARD_ERRORS = 3.0
"""Of a mean: 99.7 % of the means of half of its samples lie within."""

ROUNDING_N = 1e-9
"""Samples and means are doubles on both sides: 1e4 samples of 1e3 N sum to 1e4 * 1e3 * 1e-16 N."""

TURN_DEPTH_M = 3e-6
"""The protocol averages the depth of its turns, the check that of all states of the arm: at the
0.3 mm/s of a press a turn of 10 ms lies 3 um from its neighbour."""

CONTACT_DEPTH_M = 5e-5
"""From the turn that found contact to the line that says so the arm runs on, at a fifth of the
search's speed, for a few turns and until it has come to rest."""

ARM_WINDOW_S = 0.2
"""The protocol takes the arm's estimate as a mean over this long (protocols.guard.witness)."""

ARM_STILL_S = 0.3
"""So long after the search began, the arm still standing, it makes that mean its zero
(protocols.steps.press)."""

REMEDY = f"recording.mcap and result.json tell of different presses. {RECOVER}"


def judge_press(attempt: Attempt, record: TrialRecord) -> Iterator[Criterion]:
    """Yield tare, mean force, sign, drift, depth and the arm's force, against what was said.

    Both sides average the same raw samples between the same stamps, unfiltered, so on a whole
    recording they agree to rounding. One that lost up to half of them in a crash still has their
    mean to its standard error.
    """
    tare = record.tare_before
    if tare is None:
        return
    unloaded = _mean_force_n(attempt, tare.start_ns, tare.end_ns)
    yield _tare(attempt, "recorded_tare", tare, unloaded)
    if record.force_measured_n is not None:
        yield from _force(attempt, record, tare, unloaded)
    if record.tare_after is not None:
        again = _mean_force_n(attempt, record.tare_after.start_ns, record.tare_after.end_ns)
        yield _tare(attempt, "recorded_tare_after", record.tare_after, again)
    if record.force_drift_n is not None and record.tare_after is not None:
        sign = attempt.store.config.force_sensor.compression_sign
        drift_n = sign * (record.tare_after.mean[FZ] - tare.mean[FZ])
        yield _same("recorded_drift", drift_n, record.force_drift_n, ROUNDING_N, "N")
    if record.depth_measured_m is not None and record.contact_z_m is not None:
        yield _depth(attempt, record, record.contact_z_m, record.depth_measured_m)
    if record.arm_force_n is not None and attempt.is_whole:
        yield from _arm_force(attempt, record, record.arm_force_n)


def _force(
    attempt: Attempt, record: TrialRecord, tare: Tare, unloaded: FloatArray
) -> Iterator[Criterion]:
    sign = attempt.store.config.force_sensor.compression_sign
    measured = record.force_measured_n or 0.0
    rise_n = float(_mean_force_n(attempt, record.dwell_start_ns, record.dwell_end_ns)[FZ])
    rise_n -= float(unloaded[FZ])
    error_n = 0.0 if attempt.is_whole else _force_error_n(attempt, record, tare)
    limit_n = ROUNDING_N + STANDARD_ERRORS * error_n
    yield _same("recorded_force", sign * rise_n, measured, limit_n, "N")
    yield Criterion.judged(
        "recorded_sign",
        rise_n,
        passed=math.copysign(1.0, measured) * sign * rise_n > limit_n,
        limit=f"raw Fz moves to {'plus' if sign * measured > 0.0 else 'minus'} where result.json"
        f" says {measured:.6g} N with compression_sign {sign:+d}",
        unit="N",
        remedy=REMEDY,
    )
    deviation_n = record.force_deviation_n
    if deviation_n is not None and attempt.is_whole:
        found_n = _deviation_n(attempt, record.dwell_start_ns, record.dwell_end_ns)
        yield _same("recorded_deviation", found_n, deviation_n, ROUNDING_N, "N")


def _tare(attempt: Attempt, name: str, tare: Tare, found_n: FloatArray) -> Criterion:
    """Judge the axis that is furthest off for its noise; one that nobody measured is not."""
    errors = [_standard_error(d, tare.sample_count) for d in tare.deviation[:3]]
    limits_n = [ROUNDING_N + STANDARD_ERRORS * (0.0 if attempt.is_whole else e) for e in errors]
    off = [
        0.0 if math.isnan(again) and math.isnan(stated) else abs(again - stated) / limit_n
        for again, stated, limit_n in zip(found_n, tare.mean, limits_n, strict=False)
    ]
    worst = max(range(3), key=lambda axis: math.inf if math.isnan(off[axis]) else off[axis])
    stated_n, limit_n = tare.mean[worst], limits_n[worst]
    axis = f", raw F{'xyz'[worst]}"
    return _same(name, float(found_n[worst]), stated_n, limit_n, "N", what=axis)


def _depth(attempt: Attempt, record: TrialRecord, contact_z_m: float, depth_m: float) -> Criterion:
    """Judge the mean depth in the dwell; the height of contact has to be where the arm was."""
    z_m = _heights_m(attempt, record.dwell_start_ns, record.dwell_end_ns)
    found_m = contact_z_m - float(z_m.mean()) if len(z_m) else math.nan
    limit_m = TURN_DEPTH_M + (STANDARD_ERRORS * float(np.std(z_m)) if len(z_m) else 0.0)
    return _same("recorded_depth", found_m * _MM, depth_m * _MM, limit_m * _MM, "mm")


def _arm_force(attempt: Attempt, record: TrialRecord, stated_n: float) -> Iterator[Criterion]:
    """Judge the force that the arm felt in the dwell, less what it felt before the search.

    The protocol averages at its turns, the check at every state: on a busy computer the means of
    dwell and zero are both of other windows, by what such means scatter.
    """
    begun = _entered(attempt, record, "search")
    if begun is None or record.dwell_start_ns is None or record.dwell_end_ns is None:
        return
    stamp_ns, felt_n = _arm_means(attempt)
    dwell_n = felt_n[within(stamp_ns, record.dwell_start_ns, record.dwell_end_ns)]
    zero_n = felt_n[stamp_ns >= begun.stamp_ns + round(ARM_STILL_S * 1e9)]
    found_n, limit_n = math.nan, ROUNDING_N
    if len(dwell_n) and len(zero_n):
        # As the session had it: a resumed one may count the other way.
        sign = begun.detail.get("force_sign", attempt.store.config.robot.force_sign)
        found_n = sign * float(dwell_n.mean() - zero_n[0])
        limit_n += STANDARD_ERRORS * math.sqrt(2.0) * float(dwell_n.std())
    yield _same("recorded_arm_force", found_n, stated_n, limit_n, "N")


def _arm_means(attempt: Attempt) -> tuple[Int64Array, FloatArray]:
    """Return stamps of the arm's estimates and the mean [N] of each window that ends there."""
    has_estimate = np.isfinite(attempt.arm.tcp_force[:, FZ])
    stamp_ns = attempt.arm.stamp_ns[has_estimate]
    total_n = np.concatenate([[0.0], np.cumsum(attempt.arm.tcp_force[has_estimate, FZ])])
    ends = np.arange(1, len(total_n))
    starts = np.searchsorted(stamp_ns, stamp_ns - round(ARM_WINDOW_S * 1e9))
    return stamp_ns, (total_n[ends] - total_n[starts]) / (ends - starts)


def judge_contact(attempt: Attempt, record: TrialRecord) -> Iterator[Criterion]:
    """Yield whether the arm was at the height of contact when that was found."""
    found = _entered(attempt, record, "press")
    if record.contact_z_m is None or found is None:
        return
    stamp_ns, arm = found.stamp_ns, attempt.arm
    before = np.flatnonzero(arm.stamp_ns <= stamp_ns)
    height_m = float(arm.pose[before[-1], Z]) if len(before) else math.nan
    stated_m = found.detail.get("contact_z_m", record.contact_z_m)
    limit_m = ROUNDING_N if stated_m != record.contact_z_m else CONTACT_DEPTH_M
    stated = record.contact_z_m * _MM
    yield _same("recorded_contact", height_m * _MM, stated, limit_m * _MM, "mm")


def _entered(attempt: Attempt, record: TrialRecord, phase: str) -> JournalEvent | None:
    """Return the journal's last word of a phase of the attempt; None where it has none."""
    logged = attempt.journal.of_attempt(record.index, record.attempt)
    found = [e for e in logged if e.name == "phase" and e.detail.get("phase") == phase]
    return found[-1] if found else None


def _mean_force_n(attempt: Attempt, start_ns: int | None, end_ns: int | None) -> FloatArray:
    """Return mean raw Fx, Fy, Fz [N] of a window; NaN where it has no sample."""
    raw_n = attempt.force.between(start_ns, end_ns)[:, :3]
    return np.asarray(raw_n.mean(axis=0)) if len(raw_n) else np.full(3, math.nan)


def _deviation_n(attempt: Attempt, start_ns: int | None, end_ns: int | None) -> float:
    raw_n = attempt.force.between(start_ns, end_ns)[:, :3]
    return float(raw_n[:, FZ].std(ddof=1)) if len(raw_n) > 1 else math.nan


def _heights_m(attempt: Attempt, start_ns: int | None, end_ns: int | None) -> FloatArray:
    if start_ns is None or end_ns is None:
        return np.empty(0)
    return np.asarray(attempt.arm.pose[within(attempt.arm.stamp_ns, start_ns, end_ns), Z])


def _force_error_n(attempt: Attempt, record: TrialRecord, tare: Tare) -> float:
    """Return the standard error [N] of the mean force over what is left of the samples."""
    left = len(attempt.force.between(record.dwell_start_ns, record.dwell_end_ns))
    return math.hypot(
        _standard_error(record.force_deviation_n or 0.0, left),
        _standard_error(tare.deviation[FZ], tare.sample_count),
    )


def _standard_error(deviation: float, sample_count: int) -> float:
    return deviation / math.sqrt(max(sample_count, 1))


def _same(
    name: str, found: float, stated: float, limit: float, unit: str, *, what: str = ""
) -> Criterion:
    return Criterion.judged(
        name,
        found,
        passed=abs(found - stated) <= limit,
        limit=f"within {limit:.2g} {unit} of {stated:.6g} {unit}, as result.json says{what}",
        unit=unit,
        remedy=REMEDY,
    )
