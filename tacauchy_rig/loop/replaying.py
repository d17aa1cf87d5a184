"""From a recorded run to its replay, and from there to the report."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from reports.comparison import compare
from reports.evidence.attempt import AttemptReading, RunReading
from reports.evidence.loading import load_evidence
from reports.modulus import ModulusFit, fit_modulus
from reports.page.writing import write_report
from reports.scores.force_agreement import merge_histories
from sim.error.tolerance import Alternative, Tolerance
from sim.fields.press_fields import TrialFields
from sim.optics.sensor_camera import camera_geometry
from sim.replay import replay_forces
from sim.scene.indenter import Indenter
from sim.scene.material import Material
from sim.sensor.sensor import Sensor
from tacauchy_rig.cli.cost_lines import cost_lines
from tacauchy_rig.cli.output import say
from tacauchy_rig.config.model import ModulusSource, RigConfig
from tacauchy_rig.errors import RecordError
from tacauchy_rig.loop.optics import OpticalCalibration, optics_of
from tacauchy_rig.loop.rendering import render_trial
from tacauchy_rig.loop.replay_settings import (
    check_optics,
    drive_of,
    indenter_of,
    preset_of,
    sensor_of,
    tolerance_of,
)
from tacauchy_rig.loop.views import scored_geometry
from tacauchy_rig.run import Replay, TrialRecord
from tacauchy_rig.store.run_store import RunStore

REPLAY_NAME = "force-matched"


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """What a report found: its ``summary.json``, and whether every criterion was met."""

    content: dict[str, Any]
    passed: bool


def read_run(store: RunStore) -> RunReading:
    """Return what replay and report read of a run; each recording is opened once for both."""
    return RunReading(store, scored_geometry(sensor_of(store.config)))


def replay_run(run: RunReading, *, tolerance: Tolerance | None = None) -> Replay:
    """Replay every trial of a run that has a measured force, and keep fields and images.

    Args:
        tolerance: Take the cheapest preset that keeps it, whatever is configured.

    Raises:
        RecordError: No trial has a measured force.
        ConfigError: No preset keeps the tolerance, or there are no optics to render with.
        ConvergenceError: A force cannot be reached.
    """
    store, config = run.store, run.store.config
    sensor, indenter = sensor_of(config), indenter_of(config)
    check_optics(config, sensor)
    attempts = _measured_attempts(run)
    records = [attempt.record for attempt in attempts]
    say(f"replaying {len(records)} trials")
    replay, fields = _replayed(config, sensor, indenter, records, tolerance)
    stated, fit = replay, _modulus_of(config, records, replay)
    if fit is not None:
        sensor = _stiffened(sensor, fit.factor)
        say(
            f"  depths and forces of {fit.trial_count} trials: {fit.factor:.3f} times the stated "
            f"modulus (+-{fit.factor_deviation:.3f} between them); again with that"
        )
        replay, fields = _replayed(config, sensor, indenter, records, tolerance)
    trials = tuple(
        replace(trial, index=record.index)
        for trial, record in zip(replay.trials, records, strict=True)
    )
    optics = optics_of(store, sensor, camera_geometry(sensor))
    rendered = {
        attempt.record.index: render_trial(attempt, sensor, trial_fields, optics)
        for attempt, trial_fields in zip(attempts, fields, strict=True)
    }
    markers = [trial.markers for trial in rendered.values() if trial.markers is not None]
    _say_markers(markers)
    _say_cost(replay)
    facts = {
        **replay.model,
        **_stated_facts(sensor, optics),
        **_modulus_facts(fit, stated),
        "markers": markers,
    }
    replay = replace(replay, trials=trials, model=facts)
    store.save_replay(replay, {index: trial.kept for index, trial in rendered.items()})
    return replay


def _replayed(
    config: RigConfig,
    sensor: Sensor,
    indenter: Indenter,
    records: Sequence[TrialRecord],
    tolerance: Tolerance | None,
) -> tuple[Replay, list[TrialFields]]:
    return replay_forces(
        sensor,
        indenter,
        [record.force_measured_n or 0.0 for record in records],
        preset=preset_of(config),
        tolerance=tolerance or tolerance_of(config),
        drive=drive_of(config),
        tolerance_n=config.replay.force_tolerance,
        name=REPLAY_NAME,
        on_progress=lambda _, text: say(f"  {text}"),
    )


def _modulus_of(
    config: RigConfig, records: Sequence[TrialRecord], replay: Replay
) -> ModulusFit | None:
    """Return what the gel's modulus is to be multiplied by, where the run's depths decide it."""
    given = config.replay
    if given.young is not None or given.modulus is not ModulusSource.DEPTHS:
        return None
    curve = merge_histories([trial.force_history for trial in replay.trials])
    fit = fit_modulus(records, curve, contact_force_n=config.protocol.contact_force)
    if fit is None:
        say("  too few depths were measured to tell the modulus: the stated one is taken")
    return fit


def _stiffened(sensor: Sensor, factor: float) -> Sensor:
    """Return a sensor whose gel, all of its layers, is so many times as stiff."""

    def times(material: Material) -> Material:
        return replace(material, young_pa=factor * material.young_pa)

    layers = tuple(replace(layer, material=times(layer.material)) for layer in sensor.layers)
    return replace(sensor, material=times(sensor.material), layers=layers)


def _modulus_facts(fit: ModulusFit | None, stated: Replay) -> dict[str, Any]:
    if fit is None:
        return {}
    return {
        "modulus_factor": fit.factor,
        "modulus_factor_deviation": fit.factor_deviation,
        "modulus_trials": fit.trial_count,
        "stated_force_history": [pair for trial in stated.trials for pair in trial.force_history],
    }


def _say_cost(replay: Replay) -> None:
    """Say what the forces are worth, what that cost, and what its neighbours would have cost."""
    facts = replay.model
    worst = max(replay.trials, key=lambda trial: trial.force_error_estimate or float("inf"))
    others = [Alternative(**other) for other in facts["alternatives"]]
    error, cost = facts["force_error_largest_relative"], f"{facts['wall_s']:.1f} s"
    for line in cost_lines(error, worst.force_error_basis, cost, others):
        say(f"  {line}")


def _say_markers(markers: Sequence[Mapping[str, Any]]) -> None:
    for found in markers:
        if found.get("tracked"):
            say(
                f"  markers of trial {found['trial']}: {found['tracked']} tracked, moved "
                f"{found['recorded_largest_m'] * 1e3:.3f} mm at most, the simulated ones "
                f"{found['simulated_largest_m'] * 1e3:.3f} mm; "
                f"{found['apart_rms_m'] * 1e3:.3f} mm apart rms"
            )


def _stated_facts(sensor: Sensor, optics: OpticalCalibration) -> dict[str, Any]:
    uncertainty, source = sensor.young_uncertainty()
    return {
        "young_uncertainty_relative": uncertainty,
        "young_source": source,
        "optics": dict(optics.model.provenance),
        "scale_x_m_px": optics.geometry.scale_x_m,
        "image_centre_m": optics.geometry.centre_from_middle_m,
        "scale_y_m_px": optics.geometry.scale_y_m,
    }


def report_run(run: RunReading, *, name: str = REPLAY_NAME) -> Summary:
    """Write the report of a run and say where it is."""
    store = run.store
    replay = store.load_replay(name) if name in store.replays() else None
    report = compare(load_evidence(run, replay))
    paths = write_report(report, store.paths.report)
    say(report.verdict)
    say(f"report {paths.html.resolve()}")
    content = json.loads(paths.summary.read_text("utf-8"))
    return Summary(content=content, passed=report.passed)


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
