"""What was measured of a press, computed again from the raw samples of its recording."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from tacauchy_rig.core.arrays import FloatArray, Int64Array
from tacauchy_rig.core.run import FZ, Criterion, JournalEvent, Tare, TrialRecord
from tacauchy_rig.core.store.check.attempt import Attempt, within
from tacauchy_rig.core.store.check.consistency import RECOVER
from tacauchy_rig.core.store.recording.reading import ArmArrays, ForceArrays, Recording

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


def judge_press(attempt: Attempt, recording: Recording, record: TrialRecord) -> Iterator[Criterion]:
    """Yield tare, mean force, sign, drift, depth and the arm's force, against what was said.

    Both sides average the same raw samples between the same stamps, unfiltered, so on a whole
    recording they agree to rounding. One that lost up to half of them in a crash still has their
    mean to its standard error.
    """
    force, tare, after = recording.force(), record.tare_before, record.tare_after
    if tare is None:
        return
    yield _tare(attempt, "recorded_tare", tare, force)
    if record.force_measured_n is not None:
        yield from _force(attempt, record, record.force_measured_n, tare, force)
    if after is not None:
        yield _tare(attempt, "recorded_tare_after", after, force)
    if record.force_drift_n is not None and after is not None:
        sign = attempt.store.config.force_sensor.compression_sign
        drift_n = sign * (after.mean[FZ] - tare.mean[FZ])
        yield _same("recorded_drift", drift_n, record.force_drift_n, ROUNDING_N, "N")
    if record.depth_measured_m is not None and record.contact_z_m is not None:
        yield _depth(recording.arm(), record, record.contact_z_m, record.depth_measured_m)
    if record.arm_force_n is not None and attempt.is_whole:
        yield from _arm_force(attempt, recording.arm(), record, record.arm_force_n)


def _force(
    attempt: Attempt, record: TrialRecord, measured_n: float, tare: Tare, force: ForceArrays
) -> Iterator[Criterion]:
    sign = attempt.store.config.force_sensor.compression_sign
    pressed_n = force.between(record.dwell_start_ns, record.dwell_end_ns)
    unloaded_n = force.between(tare.start_ns, tare.end_ns)
    rise_n = float(_mean_force(pressed_n)[FZ]) - float(_mean_force(unloaded_n)[FZ])
    # Of what is left of the samples.
    error_n = math.hypot(
        _standard_error(record.force_deviation_n or 0.0, len(pressed_n)),
        _standard_error(tare.deviation[FZ], tare.sample_count),
    )
    limit_n = ROUNDING_N + STANDARD_ERRORS * (0.0 if attempt.is_whole else error_n)
    yield _same("recorded_force", sign * rise_n, measured_n, limit_n, "N")
    yield Criterion.judged(
        "recorded_sign",
        rise_n,
        passed=math.copysign(1.0, measured_n) * sign * rise_n > limit_n,
        limit=f"raw Fz moves to {'plus' if sign * measured_n > 0.0 else 'minus'} where result.json"
        f" says {measured_n:.6g} N with compression_sign {sign:+d}",
        unit="N",
        remedy=REMEDY,
    )
    if record.force_deviation_n is not None and attempt.is_whole:
        found_n = float(pressed_n[:, FZ].std(ddof=1)) if len(pressed_n) > 1 else math.nan
        yield _same("recorded_deviation", found_n, record.force_deviation_n, ROUNDING_N, "N")


def _tare(attempt: Attempt, name: str, tare: Tare, force: ForceArrays) -> Criterion:
    """Judge the axis that is furthest off for its noise; one that nobody measured is not."""
    found_n = _mean_force(force.between(tare.start_ns, tare.end_ns))
    errors = [_standard_error(d, tare.sample_count) for d in tare.deviation[:3]]
    limits_n = [ROUNDING_N + STANDARD_ERRORS * (0.0 if attempt.is_whole else e) for e in errors]
    off = [
        -1.0 if math.isnan(again) and math.isnan(stated) else abs(again - stated) / limit_n
        for again, stated, limit_n in zip(found_n, tare.mean, limits_n, strict=False)
    ]
    worst = max(range(3), key=lambda axis: math.inf if math.isnan(off[axis]) else off[axis])
    axis = f", raw F{'xyz'[worst]}"
    return _same(name, float(found_n[worst]), tare.mean[worst], limits_n[worst], "N", what=axis)


def _depth(arm: ArmArrays, record: TrialRecord, contact_z_m: float, depth_m: float) -> Criterion:
    """Judge the mean depth in the dwell; the height of contact has to be where the arm was."""
    z_m = np.empty(0)
    if record.dwell_start_ns is not None and record.dwell_end_ns is not None:
        z_m = arm.pose[within(arm.stamp_ns, record.dwell_start_ns, record.dwell_end_ns), Z]
    found_m = contact_z_m - float(z_m.mean()) if len(z_m) else math.nan
    limit_m = TURN_DEPTH_M + (STANDARD_ERRORS * float(np.std(z_m)) if len(z_m) else 0.0)
    return _same("recorded_depth", found_m * _MM, depth_m * _MM, limit_m * _MM, "mm")


def _arm_force(
    attempt: Attempt, arm: ArmArrays, record: TrialRecord, stated_n: float
) -> Iterator[Criterion]:
    """Judge the force that the arm felt in the dwell, less what it felt before the search.

    The protocol averages at its turns, the check at every state: on a busy computer the means of
    dwell and zero are both of other windows, by what such means scatter.
    """
    begun = _entered(attempt, "search")
    if begun is None or record.dwell_start_ns is None or record.dwell_end_ns is None:
        return
    stamp_ns, felt_n = _arm_means(arm)
    dwell_n = felt_n[within(stamp_ns, record.dwell_start_ns, record.dwell_end_ns)]
    zero_n = felt_n[stamp_ns >= begun.stamp_ns + round(ARM_STILL_S * 1e9)]
    found_n, limit_n = math.nan, ROUNDING_N
    if len(dwell_n) and len(zero_n):
        # As the session had it: a resumed one may count the other way.
        sign = begun.detail.get("force_sign", attempt.store.config.robot.force_sign)
        found_n = sign * float(dwell_n.mean() - zero_n[0])
        limit_n += STANDARD_ERRORS * math.sqrt(2.0) * float(dwell_n.std())
    yield _same("recorded_arm_force", found_n, stated_n, limit_n, "N")


def _arm_means(arm: ArmArrays) -> tuple[Int64Array, FloatArray]:
    """Return stamps of the arm's estimates and the mean [N] of each window that ends there."""
    has_estimate = np.isfinite(arm.tcp_force[:, FZ])
    stamp_ns = arm.stamp_ns[has_estimate]
    total_n = np.concatenate([[0.0], np.cumsum(arm.tcp_force[has_estimate, FZ])])
    ends = np.arange(1, len(total_n))
    starts = np.searchsorted(stamp_ns, stamp_ns - round(ARM_WINDOW_S * 1e9))
    return stamp_ns, (total_n[ends] - total_n[starts]) / (ends - starts)


def judge_contact(
    attempt: Attempt, recording: Recording, record: TrialRecord
) -> Iterator[Criterion]:
    """Yield whether the arm was at the height of contact when that was found."""
    found = _entered(attempt, "press")
    if record.contact_z_m is None or found is None:
        return
    arm = recording.arm()
    before = np.flatnonzero(arm.stamp_ns <= found.stamp_ns)
    height_m = float(arm.pose[before[-1], Z]) if len(before) else math.nan
    stated_m = found.detail.get("contact_z_m", record.contact_z_m)
    limit_m = ROUNDING_N if stated_m != record.contact_z_m else CONTACT_DEPTH_M
    stated = record.contact_z_m * _MM
    yield _same("recorded_contact", height_m * _MM, stated, limit_m * _MM, "mm")


def _entered(attempt: Attempt, phase: str) -> JournalEvent | None:
    """Return the journal's last word of a phase of the attempt; None where it has none."""
    phases = [e for e in attempt.events if e.name == "phase" and e.detail.get("phase") == phase]
    return phases[-1] if phases else None


def _mean_force(wrenches: FloatArray) -> FloatArray:
    """Return mean raw Fx, Fy, Fz [N]; NaN where there is no sample."""
    return np.asarray(wrenches[:, :3].mean(axis=0)) if len(wrenches) else np.full(3, math.nan)


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
