"""Presses of a run again: to the forces or depths that were measured, with one gel."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from reports.evidence.fits import ModulusFit, fit_modulus
from sim.effects.plan import plan_effects
from sim.error import setting_of
from sim.fields.press_fields import TrialFields
from sim.replay import (
    History,
    ReferencePath,
    path_depends_on_modulus,
    reference_path,
    replay_alone,
    replay_forces,
)
from sim.scene.scene import Target
from tacauchy_rig.app.replay.mounting import fits_modulus, tilted_curve
from tacauchy_rig.app.replay.optics import Say, say_nothing
from tacauchy_rig.app.replay.parts import Part
from tacauchy_rig.core.force_depth import ForceDepthCurve
from tacauchy_rig.core.long_task import time_limit
from tacauchy_rig.core.run import TrialRecord
from tacauchy_rig.core.simulated import REPLAY_NAME, Replay

Pressed = tuple[Replay, dict[int, TrialFields]]
"""A replay of which nothing is rendered yet, and fields by trial."""


def press_together(part: Part, *, on_progress: Say = say_nothing) -> Pressed:
    """Press to every measured force; if the run asks so, the depths of all trials fit the modulus.

    For a tilted indenter the modulus is fitted with an upright one, corrected by coarse presses of
    both: a tilt breaks the symmetry, and a press with it takes ten times as long. A press without
    a measured force is pressed to its depth.
    """
    on_progress(f"replaying {len(part.records)} trials")
    if not fits_modulus(part.config):
        return press_to_measured(part, None, on_progress=on_progress)
    path = _stated_path(part)
    stated = () if path is None else path.history
    fit = modulus_of([(part, stated)], on_progress=on_progress)
    if any(part.inputs.tilt_rad):
        return press_to_measured(part, fit, on_progress=on_progress)
    return press_to_measured(part, fit, stated, path, on_progress=on_progress)


def stated_history(part: Part) -> History:
    """Return (depth [m], force [N]) of the gel with the stated modulus, to the measured forces."""
    alone = _alone(part)
    if alone is not None:
        return alone[0].trials[0].force_history
    path = _stated_path(part)
    return () if path is None else path.history


def modulus_of(
    simulated: Sequence[tuple[Part, History]], *, on_progress: Say = say_nothing
) -> ModulusFit | None:
    """Fit the factor of the gel's modulus to depths and forces of all trials."""
    curves = []
    for part, history in simulated:
        curve = ForceDepthCurve.merged([history])
        is_tilted = any(part.inputs.tilt_rad)
        curves.append((part.records, tilted_curve(curve, part.inputs) if is_tilted else curve))
    fit = fit_modulus(curves, contact_force_n=simulated[0][0].config.protocol.contact_force)
    if fit is None:
        on_progress("  fewer than two trials have both force and depth: the stated modulus is used")
    else:
        on_progress(
            f"  depths and forces of {fit.trial_count} trials: {fit.factor:.3f} times the stated "
            f"modulus (+-{fit.factor_deviation:.3f} between them)"
        )
    return fit


def press_to_measured(
    part: Part,
    fit: ModulusFit | None,
    stated: History = (),
    path: ReferencePath | None = None,
    *,
    on_progress: Say = say_nothing,
) -> Pressed:
    """Press to every force, and to the depths of trials without one.

    Args:
        fit: Of the modulus; None takes the stated one.
        stated: (depth [m], force [N]) of the gel with the stated modulus.
        path: The loading path of that gel, where its states may be gone on from.
    """
    stiffer = part if fit is None else replace(part, inputs=part.inputs.stiffer(fit.factor))
    alone = _alone(stiffer)
    if alone is None:
        replay, fields, records = _on_one_path(stiffer, fit, path, on_progress)
    else:
        replay, fields, records = alone[0], [alone[1]], list(part.records)
    trials = tuple(
        replace(trial, index=record.index, force_measured_n=_measured_n(record))
        for trial, record in zip(replay.trials, records, strict=True)
    )
    model = replay.model
    if fit is not None:
        model = replace(
            model,
            modulus_factor=fit.factor,
            modulus_factor_deviation=fit.factor_deviation,
            modulus_trials=fit.trial_count,
            stated_force_history=stated,
        )
    by_trial = {record.index: found for record, found in zip(records, fields, strict=True)}
    return replace(replay, trials=trials, model=model), by_trial


def _alone(part: Part) -> tuple[Replay, TrialFields] | None:
    """Press the one trial of a part on a mesh whose bias is known; None where that cannot be."""
    accuracy = part.inputs.asked_accuracy
    if not part.is_alone or accuracy is None:
        return None
    record = part.records[0]
    target = Target(force_n=record.force_measured_n)
    if record.force_measured_n is None:
        target = Target(depth_m=record.depth_measured_m)
    return replay_alone(
        part.inputs.quick_scene(target),
        tolerance=accuracy,
        name=REPLAY_NAME,
        time_limit_s=part.config.replay.time_limit,
    )


def _on_one_path(
    part: Part, fit: ModulusFit | None, path: ReferencePath | None, on_progress: Say
) -> tuple[Replay, list[TrialFields], list[TrialRecord]]:
    """Press the trials in the order of their forces, and those without one of their depths."""
    inputs = part.settled.inputs
    with_force = [r for r in part.records if r.force_measured_n is not None]
    without = [r for r in part.records if r.force_measured_n is None]
    found = []
    for records, by_depth in ((with_force, False), (without, True)):
        if not records:
            continue
        values = [(r.depth_measured_m if by_depth else r.force_measured_n) or 0.0 for r in records]
        scene = inputs.scene([] if by_depth else values)
        if by_depth:
            on_progress(f"  no force of {len(records)} trials was measured: pressing to the depths")
            inputs = replace(inputs, tolerance=None)
            scene = replace(inputs.scene([]), target=Target(depth_m=max(values)))
        on_progress(f"  meshing {inputs.sensor.title}, preset {setting_of(scene)}{part.label}")
        found.append(
            replay_forces(
                scene,
                values,
                tolerance=inputs.tolerance or inputs.stated_accuracy,
                name=REPLAY_NAME,
                on_progress=lambda _, text: on_progress(f"  {text}"),
                reference=None if by_depth else path,
                stiffer=1.0 if fit is None else fit.factor,
                depths_from_n=part.config.protocol.contact_force if by_depth else None,
                time_limit_s=part.config.replay.time_limit,
            )
        )
    replay = replace(found[0][0], trials=tuple(t for each, _ in found for t in each.trials))
    return replay, [each for _, fields in found for each in fields], with_force + without


def _measured_n(record: TrialRecord) -> float:
    """Return what was measured [N]; not a number where an imported run has depths alone."""
    return math.nan if record.force_measured_n is None else record.force_measured_n


def _stated_path(part: Part) -> ReferencePath | None:
    """Press the gel with the stated modulus; None where no force was measured.

    A path that does not depend on the measured forces makes replays of one rig comparable: it goes
    to the largest force that a passed trial may have. Where that force is no bound of the measured
    ones, or time changes the path, it goes to these.
    """
    inputs, forces_n, protocol = part.settled.inputs, part.forces_n, part.config.protocol
    if not forces_n:
        return None
    if any(inputs.tilt_rad):
        return reference_path(inputs.upright.scene(forces_n), forces_n, keep_states=False)
    most_n = max(protocol.force_targets) + protocol.force_tolerance
    is_bound = most_n - 2.0 * protocol.force_tolerance <= max(forces_n) <= most_n
    with time_limit(part.config.replay.time_limit):
        if is_bound and not part.config.is_imported:
            scene = inputs.scene([most_n])
            if not path_depends_on_modulus(plan_effects(scene)):
                return reference_path(scene, [most_n], keep_states=True)
        return reference_path(inputs.scene(forces_n), forces_n, keep_states=True)
