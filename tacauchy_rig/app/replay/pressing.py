"""Presses of a run again: to the forces or depths that were measured, with one gel."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
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
    replay_alone,
    replay_forces,
)
from sim.scene.scene import Target
from tacauchy_rig.app.replay.inputs import ReplayInputs
from tacauchy_rig.app.replay.mounting import (
    FoundMounting,
    dwells_of,
    fits_modulus,
    tilted_curve,
    with_found_tilt,
)
from tacauchy_rig.app.replay.optics import Say, say_nothing
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.errors import RecordError, command_line
from tacauchy_rig.core.force_depth import ForceDepthCurve
from tacauchy_rig.core.long_task import time_limit
from tacauchy_rig.core.run import TrialRecord
from tacauchy_rig.core.simulated import REPLAY_NAME, Replay, ReplayModel

Pressed = tuple[Replay, dict[int, TrialFields]]
"""A replay of which nothing is rendered yet, and fields by trial."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PressTask:
    """What trials of one indenter at one place are pressed with; it can go to another process.

    Attributes:
        records: Of the trials; each has a force, or else a depth.
        config: The run's, with their indenter and place.
        label: Indenter and place, for progress.
        quick: A trial alone at its place may be pressed on a mesh whose bias is known.
    """

    inputs: ReplayInputs
    records: tuple[TrialRecord, ...]
    config: RigConfig
    label: str = ""
    quick: bool = False

    @property
    def forces_n(self) -> list[float]:
        """Measured forces [N], of the trials that have one."""
        return [r.force_measured_n for r in self.records if r.force_measured_n is not None]

    @property
    def is_alone(self) -> bool:
        """Whether its one trial may be pressed on a mesh whose bias is known.

        Not where its depth counts from a force, which a path has to go to first.
        """
        from_touch = bool(self.forces_n) or not self.config.protocol.contact_force
        accurate = self.inputs.asked_accuracy is not None
        return self.quick and len(self.records) == 1 and accurate and from_touch

    @property
    def settled(self) -> PressTask:
        """The task with the preset that ``auto`` chooses."""
        return replace(self, inputs=self.inputs.settled(self.forces_n))

    def with_modulus(self, fit: ModulusFit | None) -> PressTask:
        """Return the task with the modulus that was fitted."""
        return self if fit is None else replace(self, inputs=self.inputs.stiffer(fit.factor))


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


def press_together(task: PressTask, *, on_progress: Say = say_nothing) -> Pressed:
    """Press to every measured force; if the run asks so, the depths of all trials fit the modulus.

    For a tilted indenter the modulus is fitted with an upright one, corrected by coarse presses of
    both: a tilt breaks the symmetry, and a press with it takes ten times as long. A press without
    a measured force is pressed to its depth.

    Raises:
        ConfigError: No preset keeps the tolerance.
        ConvergenceError: A force cannot be reached.
    """
    on_progress(f"replaying {len(task.records)} trials")
    fit = path = None
    if fits_modulus(task.config):
        path = _stated_path(task)
        history = () if path is None else path.history
        fit = modulus_of([(task, history)], on_progress=on_progress)
    usable = None if any(task.inputs.tilt_rad) else path
    return press_to_measured(task, fit, usable, on_progress=on_progress)


def stated_history(task: PressTask) -> History:
    """Return (depth [m], force [N]) of the gel with the stated modulus, up to the measured forces.

    Raises:
        ConvergenceError: A force cannot be reached.
    """
    alone = _alone(task)
    if alone is not None:
        return alone[0].trials[0].force_history
    path = _stated_path(task)
    return () if path is None else path.history


def modulus_of(
    simulated: Sequence[tuple[PressTask, History]], *, on_progress: Say = say_nothing
) -> ModulusFit | None:
    """Fit the factor of the gel's modulus to depths and forces of all trials."""
    curves = []
    for task, history in simulated:
        curve = ForceDepthCurve.merged([history])
        is_tilted = any(task.inputs.tilt_rad)
        curves.append((task.records, tilted_curve(curve, task.inputs) if is_tilted else curve))
    contact_force_n = simulated[0][0].config.protocol.contact_force
    fit = fit_modulus(curves, contact_force_n=contact_force_n)
    if fit is None:
        on_progress("  fewer than two trials have both force and depth: the stated modulus is used")
    else:
        on_progress(
            f"  depths and forces of {fit.trial_count} trials: {fit.factor:.3f} times the stated "
            f"modulus (+-{fit.factor_deviation:.3f} between them)"
        )
    return fit


def press_to_measured(
    task: PressTask,
    fit: ModulusFit | None,
    path: ReferencePath | None = None,
    *,
    stated: History = (),
    on_progress: Say = say_nothing,
) -> Pressed:
    """Press to every force, and to the depths of trials without one.

    Args:
        fit: Of the modulus; None takes the stated one.
        path: Of the gel with the stated modulus.
        stated: Its history, where there is no path.

    Raises:
        ConvergenceError: A force cannot be reached.
    """
    stiffer = task.with_modulus(fit)
    alone = _alone(stiffer)
    if alone is not None:
        replay, fields = alone[0], [alone[1]]
        records = list(task.records)
    else:
        replay, fields, records = _on_one_path(stiffer, fit, path, on_progress)
    trials = tuple(
        replace(trial, index=record.index, force_measured_n=_measured_n(record))
        for trial, record in zip(replay.trials, records, strict=True)
    )
    model = _with_modulus(replay.model, fit, stated if path is None else path.history)
    by_trial = {record.index: found for record, found in zip(records, fields, strict=True)}
    return replace(replay, trials=trials, model=model), by_trial


def _alone(task: PressTask) -> tuple[Replay, TrialFields] | None:
    """Press the one trial of a task on a mesh whose bias is known; None where that cannot be."""
    accuracy = task.inputs.asked_accuracy
    if not task.is_alone or accuracy is None:
        return None
    record = task.records[0]
    target = Target(force_n=record.force_measured_n)
    if record.force_measured_n is None:
        target = Target(depth_m=record.depth_measured_m)
    return replay_alone(
        task.inputs.quick_scene(target),
        tolerance=accuracy,
        name=REPLAY_NAME,
        time_limit_s=task.config.replay.time_limit,
    )


def _on_one_path(
    task: PressTask, fit: ModulusFit | None, path: ReferencePath | None, on_progress: Say
) -> tuple[Replay, list[TrialFields], list[TrialRecord]]:
    """Press the trials in the order of their forces, and those without one of their depths."""
    inputs = task.settled.inputs
    with_force = [r for r in task.records if r.force_measured_n is not None]
    without = [r for r in task.records if r.force_measured_n is None]
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
        on_progress(f"  meshing {inputs.sensor.title}, preset {setting_of(scene)}{task.label}")
        found.append(
            replay_forces(
                scene,
                values,
                tolerance=inputs.tolerance or inputs.stated_accuracy,
                name=REPLAY_NAME,
                on_progress=lambda _, text: on_progress(f"  {text}"),
                reference=None if by_depth else path,
                stiffer=1.0 if fit is None else fit.factor,
                depths_from_n=task.config.protocol.contact_force if by_depth else None,
                time_limit_s=task.config.replay.time_limit,
            )
        )
    replay = replace(found[0][0], trials=tuple(t for each, _ in found for t in each.trials))
    return replay, [each for _, fields in found for each in fields], with_force + without


def _measured_n(record: TrialRecord) -> float:
    """Return what was measured [N]; not a number where an imported run has depths alone."""
    return math.nan if record.force_measured_n is None else record.force_measured_n


def _stated_path(task: PressTask) -> ReferencePath | None:
    """Press the gel with the stated modulus; None where no force was measured.

    A path that does not depend on the measured forces makes replays of one rig comparable: it goes
    to the largest force that a passed trial may have. Where that force is no bound of the measured
    ones, or time changes the path, it goes to these.
    """
    inputs, forces_n, protocol = task.settled.inputs, task.forces_n, task.config.protocol
    if not forces_n:
        return None
    if any(inputs.tilt_rad):
        return reference_path(inputs.upright.scene(forces_n), forces_n, keep_states=False)
    most_n = max(protocol.force_targets) + protocol.force_tolerance
    is_bound = most_n - 2.0 * protocol.force_tolerance <= max(forces_n) <= most_n
    with time_limit(task.config.replay.time_limit):
        if is_bound and not task.config.is_imported:
            scene = inputs.scene([most_n])
            if not path_depends_on_modulus(plan_effects(scene)):
                return reference_path(scene, [most_n], keep_states=True)
        return reference_path(inputs.scene(forces_n), forces_n, keep_states=True)


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
