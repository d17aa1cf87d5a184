"""Presses of a run again: to the forces or depths that were measured, with one gel."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from statistics import median

from reports.evidence.attempt import AttemptReading, RunReading
from reports.evidence.fits import ModulusFit, fit_modulus
from sim.effects.plan import plan_effects
from sim.error import setting_of
from sim.fields.press_fields import TrialFields
from sim.replay import (
    History,
    ReferencePath,
    path_depends_on_modulus,
    reference_path,
    replay_forces,
)
from sim.sensitivity import forces_at
from tacauchy_rig.app.replay.inputs import ReplayInputs
from tacauchy_rig.app.replay.mounting import (
    FoundMounting,
    dwells_of,
    fits_modulus,
    tilted_curve,
    with_found_tilt,
)
from tacauchy_rig.app.replay.optics import Say, say_nothing
from tacauchy_rig.app.replay.parts import Part
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.errors import RecordError, command_line
from tacauchy_rig.core.force_depth import ForceDepthCurve
from tacauchy_rig.core.long_task import time_limit
from tacauchy_rig.core.run import TrialRecord
from tacauchy_rig.core.simulated import REPLAY_NAME, Replay, ReplayModel

Pressed = tuple[Replay, dict[int, TrialFields]]
"""A replay of which nothing is rendered yet, and fields by trial."""


def measured_depths(run: RunReading) -> list[float]:
    """Return the measured depths of a run's trials [m], of those that have one."""
    return [each.depth_measured_m for each in measured_records(run) if each.depth_measured_m]


def mounted(
    run: RunReading, inputs: ReplayInputs, *, on_progress: Say = say_nothing
) -> FoundMounting:
    """Return the inputs of a run with its measured duration and the tilt found from moments.

    Raises:
        RecordError: No trial has a measured force.
        ConfigError: No preset keeps the tolerance.
    """
    attempts = measured_attempts(run)
    lasted = [each.press_duration_s for each in attempts]
    known = [seconds for seconds in lasted if seconds is not None]
    if known:
        inputs = replace(inputs, duration_s=median(known))
    found = with_found_tilt(dwells_of(attempts), inputs, run.store.config)
    for row in found.effects:
        on_progress(f"{row['name']} {'on' if row['on'] else 'left out'}: {row['reason']}")
    return found


def press_parts(parts: Sequence[Part], *, on_progress: Say = say_nothing) -> list[Pressed]:
    """Press to every measured force; if the run asks so, the depths of all trials fit the modulus.

    For a tilted indenter the modulus is fitted with an upright one, corrected by coarse presses of
    both: a tilt breaks the symmetry, and a press with it takes ten times as long. A press without
    a measured force is pressed to its depth.

    Raises:
        RecordError: No trial has a measured force.
        ConfigError: No preset keeps the tolerance.
        ConvergenceError: A force cannot be reached.
    """
    counts = [len(measured_records(part.run)) for part in parts]
    at = f" at {len(parts)} places or with as many indenters" if len(parts) > 1 else ""
    on_progress(f"replaying {sum(counts)} trials{at}")
    fit, loaded = None, list[ReferencePath | None]([None] * len(parts))
    if fits_modulus(parts[0].run.store.config):
        fit, loaded = _fitted(parts, on_progress)
    return [
        _pressed(part, fit, path, on_progress) for part, path in zip(parts, loaded, strict=True)
    ]


def _pressed(
    part: Part, fit: ModulusFit | None, path: ReferencePath | None, on_progress: Say
) -> Pressed:
    inputs = part.inputs if fit is None else part.inputs.stiffer(fit.factor)
    records = measured_records(part.run)
    forces_n = _forces(inputs, records, part.run.store.config.protocol.contact_force, on_progress)
    scene = inputs.scene(forces_n)
    on_progress(f"  meshing {inputs.sensor.title}, preset {setting_of(scene)}{part.label}")
    replay, fields = replay_forces(
        scene,
        forces_n,
        tolerance=inputs.tolerance or inputs.stated_accuracy,
        name=REPLAY_NAME,
        on_progress=lambda _, text: on_progress(f"  {text}"),
        reference=path,
        stiffer=1.0 if fit is None else fit.factor,
        time_limit_s=part.config.replay.time_limit,
    )
    trials = tuple(
        replace(trial, index=record.index, force_measured_n=_measured_n(record))
        for trial, record in zip(replay.trials, records, strict=True)
    )
    model = _with_modulus(replay.model, fit, () if path is None else path.history)
    by_trial = {record.index: found for record, found in zip(records, fields, strict=True)}
    return replace(replay, trials=trials, model=model), by_trial


def _measured_n(record: TrialRecord) -> float:
    """Return what was measured [N]; not a number where an imported run has depths alone."""
    return math.nan if record.force_measured_n is None else record.force_measured_n


def _forces(
    inputs: ReplayInputs, records: Sequence[TrialRecord], contact_force_n: float, on_progress: Say
) -> list[float]:
    """Return the measured forces [N]; without one, the simulated force at the measured depth."""
    without = [record for record in records if record.force_measured_n is None]
    found: dict[int, float] = {}
    if without:
        on_progress(f"  no force of {len(without)} trials was measured: pressing to the depths")
        depths_m = [record.depth_measured_m or 0.0 for record in without]
        forces_n = _forces_met(replace(inputs, tolerance=None), depths_m, contact_force_n)
        found = {r.index: force for r, force in zip(without, forces_n, strict=True)}
    return [found.get(record.index, _measured_n(record)) for record in records]


def _forces_met(
    inputs: ReplayInputs, depths_m: Sequence[float], contact_force_n: float
) -> list[float]:
    """Return F_z at depths [N], on the mesh that a press to these forces has."""
    about_n = forces_at(inputs.scene([]), depths_m, contact_force_n=contact_force_n, planned=True)
    scene = inputs.scene(about_n.tolist())
    found = forces_at(
        scene, depths_m, contact_force_n=contact_force_n, planned=True, own_target=True
    )
    return list(found.tolist())


def _loading_path(
    inputs: ReplayInputs, config: RigConfig, forces_n: Sequence[float]
) -> ReferencePath:
    """Press the stated gel to the largest force that a passed trial may have.

    A path that does not depend on the measured forces makes replays of one rig comparable. Where
    that force is no bound of the measured ones, or time changes the path, it goes to these.
    """
    protocol = config.protocol
    most_n = max(protocol.force_targets) + protocol.force_tolerance
    is_bound = most_n - 2.0 * protocol.force_tolerance <= max(forces_n) <= most_n
    if is_bound and not config.is_imported:
        scene = inputs.scene([most_n])
        if not path_depends_on_modulus(plan_effects(scene)):
            return reference_path(scene, [most_n], keep_states=True)
    return reference_path(inputs.scene(forces_n), forces_n, keep_states=True)


def _fitted(
    parts: Sequence[Part], on_progress: Say
) -> tuple[ModulusFit | None, list[ReferencePath | None]]:
    """Fit the factor of the gel's modulus to the depths and forces of all parts.

    Returns:
        The fit, and of each part the stated gel's loading path; None where the indenter is tilted,
        or no force was measured.
    """
    contact_force_n = parts[0].run.store.config.protocol.contact_force
    simulated, loaded = [], list[ReferencePath | None]()
    for k, part in enumerate(parts, start=1):
        if len(parts) > 1:
            on_progress(f"  stated modulus: place {k} of {len(parts)}{part.label}")
        inputs, records = part.inputs, measured_records(part.run)
        forces_n = [r.force_measured_n for r in records if r.force_measured_n is not None]
        is_tilted, path = any(inputs.tilt_rad), None
        if forces_n and is_tilted:
            path = reference_path(inputs.upright.scene(forces_n), forces_n, keep_states=False)
        elif forces_n:
            with time_limit(part.config.replay.time_limit):
                path = _loading_path(inputs, part.config, forces_n)
        curve = ForceDepthCurve.merged([() if path is None else path.history])
        simulated.append((records, tilted_curve(curve, inputs) if is_tilted else curve))
        loaded.append(None if is_tilted else path)
    fit = fit_modulus(simulated, contact_force_n=contact_force_n)
    if fit is None:
        on_progress("  too few trials have both force and depth: the stated modulus is used")
    else:
        on_progress(
            f"  depths and forces of {fit.trial_count} trials: {fit.factor:.3f} times the stated "
            f"modulus (+-{fit.factor_deviation:.3f} between them)"
        )
    return fit, loaded


def _with_modulus(model: ReplayModel, fit: ModulusFit | None, stated: History) -> ReplayModel:
    """Add what the run's depths say of the modulus, if they decided it."""
    if fit is None:
        return model
    return replace(
        model,
        modulus_factor=fit.factor,
        modulus_factor_deviation=fit.factor_deviation,
        modulus_trials=fit.trial_count,
        stated_force_history=stated,
    )


def measured_attempts(run: RunReading) -> list[AttemptReading]:
    """Return the attempts that ``measured_records`` names.

    Raises:
        RecordError: There is none, or a recording is missing or damaged.
    """
    return [run.read(record) for record in measured_records(run)]


def measured_records(run: RunReading) -> list[TrialRecord]:
    """Return the trials that have a force to replay; of an imported run also those with a depth.

    Raises:
        RecordError: There is none.
    """
    measured = list(_measured(run))
    if not measured:
        root = run.store.paths.root
        raise RecordError(
            f"{root}: no trial has a measured force to replay",
            remedy=f"`{command_line('resume', root)}` records them",
        )
    return measured


def has_measured(run: RunReading) -> bool:
    """Return whether any trial has what it can be pressed to."""
    return any(_measured(run))


def _measured(run: RunReading) -> Iterator[TrialRecord]:
    for record in run.records.values():
        if record is None:
            continue
        by_depth = run.store.config.is_imported and record.depth_measured_m is not None
        if record.force_measured_n is not None or by_depth:
            yield record
