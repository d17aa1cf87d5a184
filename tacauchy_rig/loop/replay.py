"""From a recorded run to its replay: the simulator presses until it meets each measured force."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from statistics import median

from reports.evidence.attempt import AttemptReading, RunReading
from reports.evidence.force_depth import ModulusFit, fit_modulus, merge_histories
from sim.error.settings import setting_of
from sim.error.tolerance import Tolerance
from sim.fields.press_fields import TrialFields
from sim.replay import force_history, forces_at, replay_forces
from sim.sensor.sensor import Sensor
from tacauchy_rig.config.model import PoseSource, RigConfig
from tacauchy_rig.errors import RecordError
from tacauchy_rig.loop.alike import check_alike
from tacauchy_rig.loop.image_causes import split_images
from tacauchy_rig.loop.inputs import ReplayInputs, inputs_of
from tacauchy_rig.loop.mounting import (
    FoundMounting,
    dwells_of,
    find_offset,
    leaned,
    moved,
    offset_of,
    tells_modulus,
    upright,
    with_found_lean,
)
from tacauchy_rig.loop.optics import Calibrate, OpticalCalibration, Say, optics_of, say_nothing
from tacauchy_rig.loop.rendering import render_trial
from tacauchy_rig.loop.settings import check_optics
from tacauchy_rig.loop.uncertainty import force_inputs
from tacauchy_rig.replayed import Replay, ReplayModel, ResidualSplit
from tacauchy_rig.run import TrialRecord
from tacauchy_rig.side_by_side import beside
from tacauchy_rig.store.replay_files import ReplayFields

REPLAY_NAME = "force-matched"
IMAGE_S = "image_s"
"""Of a trial's ``wall_s``: rendering, the no-contact frame's reading included [s]."""


def replay_run(
    run: RunReading,
    *,
    tolerance: Tolerance | None = None,
    calibrate: Calibrate | None = None,
    on_progress: Say = say_nothing,
) -> Replay:
    """Replay every trial of a run that has a measured force, and keep fields and images.

    Args:
        run: The run; the replay is written into its folder.
        tolerance: Take the cheapest preset that keeps it, whatever is configured.
        calibrate: How the sensor is calibrated where the run's configuration names no calibration
            file; its file's nominal lamps do without it.
        on_progress: Told of every step.

    Raises:
        RecordError: No trial has a measured force.
        ConfigError: No preset keeps the tolerance, there are no optics to render with, or presses
            that were imported are not alike.
        ConvergenceError: A force cannot be reached.
    """
    store, config = run.store, run.store.config
    check_alike(store)
    inputs = inputs_of(config)
    inputs = replace(inputs, tolerance=tolerance or inputs.tolerance)
    check_optics(config, inputs.sensor)
    with beside() as other:
        seen = other.submit(_optics, config.sensor.optics_calibration, inputs.sensor, calibrate)
        found = mounted(run, inputs, on_progress=on_progress)
        inputs = found.inputs
        replay, fields = press_again(run, inputs, on_progress=on_progress)
        optics, said = seen.result()
        for line in said:
            on_progress(line)
        replay, kept = render_again(run, inputs.sensor, replay, fields, optics)
        if config.replay.pose is PoseSource.FOUND:
            images = {i: made.image for i, made in kept.items() if made.image is not None}
            values = find_offset(measured_attempts(run), images, optics.geometry, config)
            found = replace(found, values=(*found.values, *values))
            if at := offset_of(values):
                on_progress("  the contact is seen beside its place: again there")
                inputs = moved(inputs, at)
                replay, fields = press_again(run, inputs, on_progress=on_progress)
                replay, kept = render_again(run, inputs.sensor, replay, fields, optics)
                replay = replace(replay, model=replace(replay.model, found_offset_m=at))
        on_progress("trying what uncertain inputs change of the force")
        tried = other.submit(force_inputs, inputs, config, measured_depths(run), found=found.values)
        residual = residual_split(run, inputs, replay, kept, optics, on_progress=on_progress)
        model = replace(
            replay.model,
            found=found.values,
            effects=(*replay.model.effects, *found.effects),
            force_inputs=tried.result(),
            residual=residual,
        )
    replay = replace(replay, model=model)
    store.save_replay(replay, kept)
    return replay


def _optics(
    given: str, sensor: Sensor, calibrate: Calibrate | None
) -> tuple[OpticalCalibration, list[str]]:
    """Return how images are rendered, and what was said of it."""
    said: list[str] = []
    return optics_of(given, sensor, calibrate=calibrate, on_progress=said.append), said


def residual_split(
    run: RunReading,
    inputs: ReplayInputs,
    replay: Replay,
    kept: Mapping[int, ReplayFields],
    optics: OpticalCalibration,
    *,
    on_progress: Say = say_nothing,
) -> ResidualSplit | None:
    """Say what the residual of a replay's images is made of, trying each cause coarsely."""
    on_progress("trying what the images' residual is made of")
    sensor = inputs.sensor.stiffer(replay.model.modulus_factor or 1.0)
    images = {index: each.image for index, each in kept.items() if each.image is not None}
    return split_images(
        measured_attempts(run),
        images,
        replace(inputs, sensor=sensor),
        optics,
        run.store.config,
        on_progress=on_progress,
    )


def measured_depths(run: RunReading) -> list[float]:
    """Return the measured depths of a run's trials [m]; empty where nobody measured any."""
    records = [attempt.record for attempt in measured_attempts(run)]
    return [record.depth_measured_m for record in records if record.depth_measured_m]


def mounted(
    run: RunReading, inputs: ReplayInputs, *, on_progress: Say = say_nothing
) -> FoundMounting:
    """Return how a run is replayed in its own time, and with the lean that its moments tell.

    Raises:
        RecordError: No trial has a measured force.
        ConfigError: No preset keeps the tolerance.
    """
    attempts = measured_attempts(run)
    lasted = [each.press_duration_s for each in attempts]
    known = [seconds for seconds in lasted if seconds is not None]
    if known:
        inputs = replace(inputs, duration_s=median(known))
    found = with_found_lean(dwells_of(attempts), inputs, run.store.config)
    for row in found.effects:
        on_progress(f"{row['name']} {'on' if row['on'] else 'left out'}: {row['reason']}")
    return found


def press_again(
    run: RunReading, inputs: ReplayInputs, *, on_progress: Say = say_nothing
) -> tuple[Replay, dict[int, TrialFields]]:
    """Press every measured force of a run, with the modulus that its depths tell if it asks so.

    Where the indenter leans, an upright one and coarse presses of both tell the modulus: a lean
    breaks the symmetry, and a press with it takes ten times as long.

    Returns:
        The replay, of which nothing is rendered yet, and the fields by trial.

    Raises:
        RecordError: No trial has a measured force.
        ConfigError: No preset keeps the tolerance.
        ConvergenceError: A force cannot be reached.
    """
    config = run.store.config
    records = [attempt.record for attempt in measured_attempts(run)]
    on_progress(f"replaying {len(records)} trials")
    forces_n = _forces(inputs, records, config, on_progress)
    fit: ModulusFit | None = None
    stated: tuple[tuple[float, float], ...] = ()
    if tells_modulus(config):
        fit, stated = _told(inputs, forces_n, records, config, on_progress)
    if fit is not None:
        inputs = replace(inputs, sensor=inputs.sensor.stiffer(fit.factor))
    replay, fields = _replayed(inputs, forces_n, on_progress)
    trials = tuple(
        replace(trial, index=record.index, force_measured_n=_measured_n(record))
        for trial, record in zip(replay.trials, records, strict=True)
    )
    model = _with_modulus(replay.model, fit, stated)
    by_trial = {record.index: found for record, found in zip(records, fields, strict=True)}
    return replace(replay, trials=trials, model=model), by_trial


def render_again(
    run: RunReading,
    sensor: Sensor,
    replay: Replay,
    fields: Mapping[int, TrialFields],
    optics: OpticalCalibration,
) -> tuple[Replay, dict[int, ReplayFields]]:
    """Render what was pressed, each trial over its own no-contact frame.

    Returns:
        The replay with what the camera sees of it, and arrays and images by trial.

    Raises:
        RecordError: A recording has no readable no-contact frame.
        ConfigError: The frame's markers are not where the sensor's file says.
    """
    rendered, image_s = {}, {}
    for attempt in measured_attempts(run):
        index, started = attempt.record.index, time.perf_counter()
        rendered[index] = render_trial(attempt, sensor, fields[index], optics)
        image_s[index] = time.perf_counter() - started
    trials = tuple(
        replace(trial, wall_s={**trial.wall_s, IMAGE_S: image_s[trial.index]})
        if trial.index in image_s
        else trial
        for trial in replay.trials
    )
    markers = tuple(trial.markers for trial in rendered.values() if trial.markers is not None)
    model = replace(_seen_by_the_camera(replay.model, sensor, optics), markers=markers)
    kept = {i: trial.kept for i, trial in rendered.items()}
    return replace(replay, trials=trials, model=model), kept


def _replayed(
    inputs: ReplayInputs, forces_n: Sequence[float], on_progress: Say
) -> tuple[Replay, list[TrialFields]]:
    scene = inputs.scene(forces_n)
    on_progress(f"  meshing {inputs.sensor.title}, preset {setting_of(scene)}")
    return replay_forces(
        scene,
        forces_n,
        tolerance=inputs.tolerance,
        name=REPLAY_NAME,
        on_progress=lambda _, text: on_progress(f"  {text}"),
    )


def _measured_n(record: TrialRecord) -> float:
    """Return what was measured [N]; not a number where an imported run has depths alone."""
    return math.nan if record.force_measured_n is None else record.force_measured_n


def _forces(
    inputs: ReplayInputs, records: Sequence[TrialRecord], config: RigConfig, on_progress: Say
) -> list[float]:
    """Return the measured forces [N]; without any the simulated ones at the measured depths.

    Pressed to them, a depth is met.
    """
    known = [record.force_measured_n for record in records]
    if measured_n := [force for force in known if force is not None]:
        return measured_n
    on_progress("  no force was measured: pressing to the depths")
    return forces_at(
        replace(inputs, tolerance=None).scene([]),
        [record.depth_measured_m or 0.0 for record in records],
        contact_force_n=config.protocol.contact_force,
    )


def _told(
    inputs: ReplayInputs,
    forces_n: Sequence[float],
    records: Sequence[TrialRecord],
    config: RigConfig,
    on_progress: Say,
) -> tuple[ModulusFit | None, tuple[tuple[float, float], ...]]:
    """Return what the gel's modulus is to be multiplied by, as the run's depths tell, and why.

    Returns:
        The factor, and (depth [m], F_z [N]) of the stated gel; empty where the indenter leans.
    """
    history = force_history(upright(inputs).scene(forces_n), forces_n)
    leans = any(inputs.mounting.lean_rad)
    curve = merge_histories([history])
    fit = fit_modulus(
        records,
        leaned(curve, inputs) if leans else curve,
        contact_force_n=config.protocol.contact_force,
    )
    if fit is None:
        on_progress("  too few depths were measured to tell the modulus: the stated one is taken")
        return None, ()
    on_progress(
        f"  depths and forces of {fit.trial_count} trials: {fit.factor:.3f} times the stated "
        f"modulus (+-{fit.factor_deviation:.3f} between them)"
    )
    return fit, () if leans else history


def _with_modulus(
    model: ReplayModel, fit: ModulusFit | None, stated: tuple[tuple[float, float], ...]
) -> ReplayModel:
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


def _seen_by_the_camera(
    model: ReplayModel, sensor: Sensor, optics: OpticalCalibration
) -> ReplayModel:
    """Add what sensor and calibration state: the modulus' uncertainty, optics and scale."""
    uncertainty, source = sensor.young_uncertainty()
    return replace(
        model,
        young_uncertainty_relative=uncertainty,
        young_source=source,
        optics=dict(optics.model.provenance),
        scale_x_m_px=optics.geometry.scale_x_m,
        image_centre_m=optics.geometry.centre_from_middle_m,
        scale_y_m_px=optics.geometry.scale_y_m,
    )


def measured_attempts(run: RunReading) -> list[AttemptReading]:
    """Return the attempts that have a force to replay; of an imported run without, a depth.

    Raises:
        RecordError: There is none.
    """
    records = [record for record in run.records.values() if record is not None]
    measured = [record for record in records if record.force_measured_n is not None]
    if not measured and run.store.config.is_imported:
        measured = [record for record in records if record.depth_measured_m is not None]
    if not measured:
        root = run.store.paths.root
        raise RecordError(
            f"{root}: no trial has a measured force to replay",
            remedy=f"`tacauchy-rig resume {root}` records them",
        )
    return [run.read(record) for record in measured]
