"""The emulated world's truth beside what was recovered of it: modulus, surface, tilt, shift."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from reports.comparison.result_types import TrialResult
from reports.evidence.evidence_types import EmulatedWorld, RunEvidence, TruthComparison
from tacauchy_rig.core.run import FZ

_PER_SI = {"N": 1.0, "mm": 1e3, "kPa": 1e-3, "mN": 1e3, "mN/s": 1e3, "mrad": 1e3}
"""Of each unit in a newton, metre, pascal, newton per second or radian."""


def recover_truth(
    evidence: RunEvidence, trials: Sequence[TrialResult]
) -> tuple[TruthComparison, ...]:
    """Put every true value that the pipeline can see beside what it made of it."""
    world = evidence.world
    if world is None:
        return ()
    return tuple(
        TruthComparison(
            name=name,
            true=true * _PER_SI[unit],
            recovered=recovered * _PER_SI[unit],
            unit=unit,
            trial=trial,
        )
        for name, unit, true, recovered, trial in _compared(world, evidence, trials)
        if isinstance(true, float) and not math.isnan(true) and recovered is not None
    )


def _compared(
    world: EmulatedWorld, evidence: RunEvidence, trials: Sequence[TrialResult]
) -> Iterator[tuple[str, str, Any, float | None, int]]:
    """Yield name, unit, true and recovered value in SI, and the trial or zero."""
    values, model = world.values, evidence.model
    records = [t.record for t in evidence.trials if t.record is not None]
    dwells = [(t, *world.dwells[t.index]) for t in trials if t.index in world.dwells]
    for t, true_n, _ in dwells:
        yield "mean force in the dwell", "N", true_n, t.force_measured_n, t.index
    for t, _, true_m in dwells:
        yield "mean depth in the dwell", "mm", true_m, t.depth_measured_m, t.index
    for record in records:
        z_m = record.contact_z_m
        found_m = None if z_m is None else z_m - world.surface_expected_m
        name = "height of the gel above the expected"
        yield name, "mm", values.get("surface_error_m"), found_m, record.index
    poses = [t.corrections.pose for t in trials if t.corrections and t.corrections.pose]
    # What the camera's calibration knows of the place is added to what the images are still off.
    known = (0.0, 0.0) if model is None else model.image_centre_m
    found = {} if model is None else {each.name: each.value for each in model.found}
    for axis, name in enumerate("xy"):
        parts = [_part(values.get(each), axis) for each in ("pose_error_m", "image_shift_m")]
        shifts = (pose.x_mm if name == "x" else pose.y_mm for pose in poses)
        seen = [shift for shift in shifts if shift is not None]
        off_m = known[axis] + 1e-3 * float(np.mean(seen)) if seen else None
        yield f"contact seen off its place along {name}", "mm", sum(parts), off_m, 0
    for axis, name in enumerate("xy"):  # as fitted to moments, whether it was applied or not
        true_rad = _part(values.get("tilt_rad"), axis)
        found_rad = found.get(f"lean towards {name}")  # the name that replays on disk have
        yield f"tilt of the tool towards {name}", "mrad", true_rad, found_rad, 0
    ratios = [
        t.force_measured_n / t.force.force_predicted_n
        for t in trials
        if t.force_measured_n is not None and t.force.force_predicted_n
    ]
    if model is not None and ratios:
        # Force is linear in the modulus.
        found_pa = model.young_pa / (model.modulus_factor or 1.0) * float(np.mean(ratios))
        name = "modulus, from force at the measured depth"
        yield name, "kPa", values.get("young_pa"), found_pa, 0
    tares = [(r.tare_before, r.tare_after) for r in records if r.tare_before and r.tare_after]
    if tares:
        variances = [tare.deviation[FZ] ** 2 for pair in tares for tare in pair]
        noise_n = math.sqrt(float(np.mean(variances)))
        yield "noise of a force sample", "mN", values.get("force_noise_n"), noise_n, 0
    slopes = [
        (after.mean[FZ] - before.mean[FZ]) / ((after.start_ns - before.start_ns) * 1e-9)
        for before, after in tares
        if after.start_ns > before.start_ns
    ]
    if slopes:
        drift_n_s = float(np.mean(slopes))
        yield "drift of the force sensor", "mN/s", values.get("force_drift_n_s"), drift_n_s, 0


def _part(pair: Any, axis: int) -> float:
    """Return one of two coordinates of a truth that was read; NaN where it is not known."""
    return float(pair[axis]) if isinstance(pair, list | tuple) else math.nan
