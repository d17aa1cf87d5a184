"""How well a dry run recovered the emulated world that it could not see."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from reports.comparison.results import TrialResult
from reports.evidence.evidence import EmulatedWorld, RunEvidence, TruthComparison
from tacauchy_rig.core.run import FZ, TrialRecord

_PER_SI = {"N": 1.0, "mm": 1e3, "kPa": 1e-3, "mN": 1e3, "mN/s": 1e3, "mrad": 1e3}
"""Of each unit in a newton, metre, pascal, newton per second or radian."""


def recover_truth(
    evidence: RunEvidence, trials: Sequence[TrialResult]
) -> tuple[TruthComparison, ...]:
    """Put every true value that the pipeline can see beside what it made of it."""
    world = evidence.world
    if world is None:
        return evidence.truth
    return (
        *evidence.truth,
        *_dwell_means(world, trials),
        *_surface(world, evidence),
        *_contact_place(world, evidence, trials),
        *_tilt(world, evidence),
        *_modulus(world, evidence, trials),
        *_force_channel(world, evidence),
    )


def _compared(
    name: str, unit: str, true: float, recovered: float, trial: int = 0
) -> TruthComparison:
    """Set two SI values side by side in a unit for readers."""
    factor = _PER_SI[unit]
    return TruthComparison(
        name=name, true=true * factor, recovered=recovered * factor, unit=unit, trial=trial
    )


def _dwell_means(world: EmulatedWorld, trials: Sequence[TrialResult]) -> Iterator[TruthComparison]:
    """Yield the forces of all trials, then their depths."""
    dwells = [(trial, world.dwells[trial.index]) for trial in trials if trial.index in world.dwells]
    for t, true in dwells:
        if t.force_measured_n is not None:
            force_n = t.force_measured_n
            yield _compared("mean force in the dwell", "N", true.force_n, force_n, t.index)
    for t, true in dwells:
        if t.depth_measured_m is not None:
            depth_m = t.depth_measured_m
            yield _compared("mean depth in the dwell", "mm", true.depth_m, depth_m, t.index)


def _surface(world: EmulatedWorld, evidence: RunEvidence) -> Iterator[TruthComparison]:
    name, error_m = "height of the gel above the expected", world.values.get("surface_error_m")
    for record in _records(evidence):
        if isinstance(error_m, float) and record.contact_z_m is not None:
            found_m = record.contact_z_m - world.surface_expected_m
            yield _compared(name, "mm", error_m, found_m, record.index)


def _contact_place(
    world: EmulatedWorld, evidence: RunEvidence, trials: Sequence[TrialResult]
) -> Iterator[TruthComparison]:
    """Add what the camera's calibration knows of the place to what the images are still off."""
    calibrated = (0.0, 0.0) if evidence.model is None else evidence.model.image_centre_m
    poses = [t.corrections.pose for t in trials if t.corrections and t.corrections.pose]
    parts = [world.values.get(name) for name in ("pose_error_m", "image_shift_m")]
    known = [part for part in parts if isinstance(part, list | tuple)]
    for axis, name in enumerate("xy"):
        found = [p.x_mm if name == "x" else p.y_mm for p in poses]
        off_mm = [value for value in found if value is not None]
        if off_mm and len(known) == len(parts):
            yield TruthComparison(
                name=f"contact seen off its place along {name}",
                true=sum(float(part[axis]) for part in known) * 1e3,
                recovered=calibrated[axis] * 1e3 + float(np.mean(off_mm)),
                unit="mm",
            )


def _tilt(world: EmulatedWorld, evidence: RunEvidence) -> Iterator[TruthComparison]:
    """Yield the tilt fitted to moments, whether it was applied or not."""
    true = world.values.get("tilt_rad")
    found = {} if evidence.model is None else {each.name: each for each in evidence.model.found}
    for axis, name in enumerate("xy"):
        each = found.get(f"lean towards {name}")  # the name that replays on disk have
        value = None if each is None else each.value
        if value is not None and isinstance(true, list | tuple):
            yield _compared(f"tilt of the tool towards {name}", "mrad", float(true[axis]), value)


def _modulus(
    world: EmulatedWorld, evidence: RunEvidence, trials: Sequence[TrialResult]
) -> Iterator[TruthComparison]:
    """Scale the stated modulus by measured over predicted force; linear in the modulus."""
    model, true = evidence.model, world.values.get("young_pa")
    ratios = [
        t.force_measured_n / t.force.force_predicted_n
        for t in trials
        if t.force_measured_n is not None and t.force.force_predicted_n
    ]
    if model is not None and isinstance(true, float) and ratios:
        stated_pa = model.young_pa / (model.modulus_factor or 1.0)
        found_pa = stated_pa * float(np.mean(ratios))
        yield _compared("modulus, from force at the measured depth", "kPa", true, found_pa)


def _force_channel(world: EmulatedWorld, evidence: RunEvidence) -> Iterator[TruthComparison]:
    tared = [
        (r.tare_before, r.tare_after)
        for r in _records(evidence)
        if r.tare_before is not None and r.tare_after is not None
    ]
    noise, drift = world.values.get("force_noise_n"), world.values.get("force_drift_n_s")
    if not tared or not isinstance(noise, float) or not isinstance(drift, float):
        return
    variances = [tare.deviation[FZ] ** 2 for pair in tared for tare in pair]
    found_n = math.sqrt(float(np.mean(variances)))
    yield _compared("noise of a force sample", "mN", noise, found_n)
    slopes = [
        (after.mean[FZ] - before.mean[FZ]) / ((after.start_ns - before.start_ns) * 1e-9)
        for before, after in tared
        if after.start_ns > before.start_ns
    ]
    if slopes:
        yield _compared("drift of the force sensor", "mN/s", drift, float(np.mean(slopes)))


def _records(evidence: RunEvidence) -> list[TrialRecord]:
    return [t.record for t in evidence.trials if t.record is not None]
