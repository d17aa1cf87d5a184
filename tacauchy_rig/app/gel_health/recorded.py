"""Choose comparable presses of two runs, and read what was measured of them."""

from __future__ import annotations

import numpy as np

from reports.evidence.attempt import AttemptReading, RunReading
from tacauchy_rig.app.gel_health.comparison import GelState, PressMeasures, compare_presses
from tacauchy_rig.core.config.uncertainty import stated_uncertainty
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import FZ


def compare_runs(before: RunReading, now: RunReading) -> GelState:
    """Compare a run's press with the one of an earlier run that is nearest to it in force."""
    press = _nearest(now, None)
    error_m = stated_uncertainty(now.store.config, "depth").value
    known = _nearest(before, press.record.force_measured_n)
    return compare_presses(measures_of(known), measures_of(press), depth_uncertainty_m=error_m)


def nearest_force_n(run: RunReading, force_n: float) -> float:
    """Return the target [N] of the passed press of a run that is nearest to a force [N]."""
    return _nearest(run, force_n).record.force_target_n


def _nearest(run: RunReading, force_n: float | None) -> AttemptReading:
    passed = [each for each in run.records.values() if each is not None and each.passed]
    if not passed:
        raise RecordError(
            f"{run.store.paths.root}: none of its presses passed",
            remedy="name a run with a passed press: `tacauchy-rig run rig.toml --press-only`",
        )
    wanted_n = passed[0].force_target_n if force_n is None else force_n
    return run.read(min(passed, key=lambda each: abs(each.force_target_n - wanted_n)))


def measures_of(attempt: AttemptReading) -> PressMeasures:
    """Return what was measured of a passed press, up to the beginning of its dwell."""
    force, depth, images = attempt.force_curve, attempt.depth_curve, attempt.images
    tare = attempt.record.tare_before
    if force is None or depth is None or images is None or tare is None:
        raise RecordError(
            f"trial {attempt.record.index} of {attempt.store.paths.root}: images, zero or contact "
            "are missing",
            remedy="name another run",
        )
    depth_m = np.interp(force.time_s, depth.time_s, depth.value)
    rises = (force.time_s < 0.0) & (force.time_s > depth.time_s[0]) & (depth_m > 0.0)
    if not rises.any():
        raise RecordError(
            f"trial {attempt.record.index} of {attempt.store.paths.root}: no force was recorded "
            "between its contact and its dwell",
            remedy="name another run",
        )
    return PressMeasures(
        depth_m=depth_m[rises],
        force_n=force.value[rises],
        unloaded=images.reference.astype(np.float64),
        pressed=images.real.astype(np.float64),
        zero_n=tare.mean[FZ],
        zero_deviation_n=tare.deviation[FZ],
    )
