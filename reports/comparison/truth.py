"""How well a dry run recovered the emulated world that it could not see."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from reports.comparison.results import TrialResult
from reports.evidence.evidence import EmulatedWorld, RunEvidence, TruthComparison
from tacauchy_rig.run import FZ, TrialRecord


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
        *_modulus(world, evidence, trials),
        *_force_channel(world, evidence),
    )


def _dwell_means(world: EmulatedWorld, trials: Sequence[TrialResult]) -> Iterator[TruthComparison]:
    """Yield the forces of all trials, then their depths."""
    dwells = [(trial, world.dwells[trial.index]) for trial in trials if trial.index in world.dwells]
    for name, unit, factor, pairs in (
        ("force", "N", 1.0, [(t, true.force_n, t.force_measured_n) for t, true in dwells]),
        ("depth", "mm", 1e3, [(t, true.depth_m, t.depth_measured_m) for t, true in dwells]),
    ):
        for trial, true, measured in pairs:
            if measured is not None:
                yield TruthComparison(
                    name=f"mean {name} in the dwell",
                    true=true * factor,
                    recovered=measured * factor,
                    unit=unit,
                    trial=trial.index,
                )


def _surface(world: EmulatedWorld, evidence: RunEvidence) -> Iterator[TruthComparison]:
    error = world.values.get("surface_error_m")
    for record in _records(evidence):
        if isinstance(error, float) and record.contact_z_m is not None:
            yield TruthComparison(
                name="height of the gel above the expected",
                true=error * 1e3,
                recovered=(record.contact_z_m - world.surface_expected_m) * 1e3,
                unit="mm",
                trial=record.index,
            )


def _contact_place(
    world: EmulatedWorld, evidence: RunEvidence, trials: Sequence[TrialResult]
) -> Iterator[TruthComparison]:
    """Add what the camera's calibration knows of the place to what the images are still off."""
    calibrated = (0.0, 0.0) if evidence.model is None else evidence.model.image_centre_m
    poses = [t.corrections.pose for t in trials if t.corrections and t.corrections.pose]
    for axis, name in enumerate("xy"):
        found = [p.x_mm if name == "x" else p.y_mm for p in poses]
        known = [value for value in found if value is not None]
        true = _sum_of(world.values, ("pose_error_m", "image_shift_m"), axis)
        if known and true is not None:
            yield TruthComparison(
                name=f"contact seen off its place along {name}",
                true=true * 1e3,
                recovered=calibrated[axis] * 1e3 + float(np.mean(known)),
                unit="mm",
            )


def _sum_of(values: Mapping[str, Any], names: tuple[str, ...], axis: int) -> float | None:
    parts = [values.get(name) for name in names]
    known = [float(part[axis]) for part in parts if isinstance(part, list | tuple)]
    return sum(known) if len(known) == len(names) else None


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
        yield TruthComparison(
            name="modulus, from force at the measured depth",
            true=true * 1e-3,
            recovered=stated_pa * float(np.mean(ratios)) * 1e-3,
            unit="kPa",
        )


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
    yield TruthComparison(
        name="noise of a force sample",
        true=noise * 1e3,
        recovered=math.sqrt(float(np.mean(variances))) * 1e3,
        unit="mN",
    )
    slopes = [
        (after.mean[FZ] - before.mean[FZ]) / ((after.start_ns - before.start_ns) * 1e-9)
        for before, after in tared
        if after.start_ns > before.start_ns
    ]
    if slopes:
        yield TruthComparison(
            name="drift of the force sensor",
            true=drift * 1e3,
            recovered=float(np.mean(slopes)) * 1e3,
            unit="mN/s",
        )


def _records(evidence: RunEvidence) -> list[TrialRecord]:
    return [t.record for t in evidence.trials if t.record is not None]
