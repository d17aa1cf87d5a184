"""From a recorded run to its replay: the simulator presses until it meets each measured force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from reports.evidence.attempt import AttemptReading, RunReading
from reports.evidence.force_depth import ModulusFit, fit_modulus, merge_histories
from sim.error.measured_errors import setting_of
from sim.error.tolerance import Tolerance
from sim.fields.press_fields import TrialFields
from sim.replay import replay_forces, replay_scene
from sim.scene.material import Material
from sim.sensor.sensor import Sensor
from tacauchy_rig.config.model import ModulusSource, RigConfig
from tacauchy_rig.errors import RecordError
from tacauchy_rig.loop.optics import Calibrate, OpticalCalibration, Say, optics_of, say_nothing
from tacauchy_rig.loop.rendering import render_trial
from tacauchy_rig.loop.settings import (
    check_optics,
    drive_of,
    indenter_of,
    preset_of,
    sensor_of,
    tolerance_of,
)
from tacauchy_rig.replayed import Replay, ReplayModel
from tacauchy_rig.run import TrialRecord

REPLAY_NAME = "force-matched"


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
        ConfigError: No preset keeps the tolerance, or there are no optics to render with.
        ConvergenceError: A force cannot be reached.
    """
    store, config = run.store, run.store.config
    sensor = sensor_of(config)
    check_optics(config, sensor)
    attempts = _measured_attempts(run)
    records = [attempt.record for attempt in attempts]
    on_progress(f"replaying {len(records)} trials")
    replay, fields = _replayed(config, sensor, records, tolerance, on_progress)
    stated, fit = replay, _modulus_of(config, records, replay, on_progress)
    if fit is not None:
        sensor = _stiffened(sensor, fit.factor)
        on_progress(
            f"  depths and forces of {fit.trial_count} trials: {fit.factor:.3f} times the stated "
            f"modulus (+-{fit.factor_deviation:.3f} between them); again with that"
        )
        replay, fields = _replayed(config, sensor, records, tolerance, on_progress)
    trials = tuple(
        replace(trial, index=record.index)
        for trial, record in zip(replay.trials, records, strict=True)
    )
    optics = optics_of(
        config.sensor.optics_calibration, sensor, calibrate=calibrate, on_progress=on_progress
    )
    rendered = {
        attempt.record.index: render_trial(attempt, sensor, trial_fields, optics)
        for attempt, trial_fields in zip(attempts, fields, strict=True)
    }
    markers = [trial.markers for trial in rendered.values() if trial.markers is not None]
    model = _seen_by_the_camera(_with_modulus(replay.model, fit, stated), sensor, optics)
    replay = replace(replay, trials=trials, model=replace(model, markers=tuple(markers)))
    store.save_replay(replay, {index: trial.kept for index, trial in rendered.items()})
    return replay


def _replayed(
    config: RigConfig,
    sensor: Sensor,
    records: Sequence[TrialRecord],
    tolerance: Tolerance | None,
    on_progress: Say,
) -> tuple[Replay, list[TrialFields]]:
    forces_n = [record.force_measured_n or 0.0 for record in records]
    asked = tolerance or tolerance_of(config)
    scene = replay_scene(
        sensor,
        indenter_of(config),
        forces_n,
        preset=preset_of(config),
        tolerance=asked,
        drive=drive_of(config),
        tolerance_n=config.replay.force_tolerance,
    )
    on_progress(f"  meshing {sensor.title}, preset {setting_of(scene)}")
    return replay_forces(
        scene,
        forces_n,
        tolerance=asked,
        name=REPLAY_NAME,
        on_progress=lambda _, text: on_progress(f"  {text}"),
    )


def _modulus_of(
    config: RigConfig, records: Sequence[TrialRecord], replay: Replay, on_progress: Say
) -> ModulusFit | None:
    """Return what the gel's modulus is to be multiplied by, where the run's depths decide it."""
    given = config.replay
    if given.young is not None or given.modulus is not ModulusSource.DEPTHS:
        return None
    curve = merge_histories([trial.force_history for trial in replay.trials])
    fit = fit_modulus(records, curve, contact_force_n=config.protocol.contact_force)
    if fit is None:
        on_progress("  too few depths were measured to tell the modulus: the stated one is taken")
    return fit


def _stiffened(sensor: Sensor, factor: float) -> Sensor:
    """Return a sensor whose gel, all of its layers, is so many times as stiff."""

    def times(material: Material) -> Material:
        return replace(material, young_pa=factor * material.young_pa)

    layers = tuple(replace(layer, material=times(layer.material)) for layer in sensor.layers)
    return replace(sensor, material=times(sensor.material), layers=layers)


def _with_modulus(model: ReplayModel, fit: ModulusFit | None, stated: Replay) -> ReplayModel:
    """Add what the run's depths say of the modulus, if they decided it."""
    if fit is None:
        return model
    return replace(
        model,
        modulus_factor=fit.factor,
        modulus_factor_deviation=fit.factor_deviation,
        modulus_trials=fit.trial_count,
        stated_force_history=tuple(pair for trial in stated.trials for pair in trial.force_history),
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


def _measured_attempts(run: RunReading) -> list[AttemptReading]:
    records = [record for record in run.records.values() if record is not None]
    measured = [record for record in records if record.force_measured_n is not None]
    if not measured:
        root = run.store.paths.root
        raise RecordError(
            f"{root}: no trial has a measured force to replay",
            remedy=f"`tacauchy-rig resume {root}` records them",
        )
    return [run.read(record) for record in measured]
