"""What a run asks of other simulators, and what its own replay answers."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from reports.comparison.judging import outputs_of_replay
from reports.evidence.attempt import RunReading, readable
from reports.evidence.evidence import RunEvidence
from reports.evidence.pressure import pressure_at, shear_at
from sim.scene.indenter import describe
from tacauchy_rig import __version__
from tacauchy_rig.app.replay.inputs import inputs_of
from tacauchy_rig.app.replay.pressing import REPLAY_NAME
from tacauchy_rig.app.replay.replay import IMAGE_S
from tacauchy_rig.app.replay.settings import sensor_of
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.outputs import AskedPress, Outputs, Simulator, Task
from tacauchy_rig.core.replayed import Replay, ReplayTrial
from tacauchy_rig.core.versions import machine

OURS = "tacauchy_rig"


def references_of(evidence: RunEvidence) -> dict[int, ImageArray]:
    """Return the no-contact frames by trial, as far as they can be read."""
    return {t.index: t.images.reference for t in evidence.trials if t.images is not None}


def task_of(run: RunReading, evidence: RunEvidence) -> tuple[Task, list[AskedPress]]:
    """Return what a simulator has to know of a run to press its presses."""
    config = run.store.config
    view, inputs = sensor_of(config).camera, inputs_of(config)
    imported = evidence.imported
    others = {} if imported is None else {trial.index: trial for trial in imported.trials}
    presses = []
    for trial in evidence.trials:
        record, other = trial.record, others.get(trial.index)
        place = inputs.mounting.offset_m if other is None else other.place_m
        presses.append(
            AskedPress(
                press=trial.index,
                force_n=None if record is None else record.force_measured_n,
                depth_m=None if record is None else record.depth_measured_m,
                place_x_m=None if place is None else place[0],
                place_y_m=None if place is None else place[1],
                indenter=(other.indenter if other is not None else "") or describe(inputs.indenter),
            )
        )
    task = Task(
        run=str(evidence.provenance.get("name", "")),
        sensor=config.sensor.name,
        friction=config.replay.friction,
        contact_force_n=evidence.contact_force_n,
        width_px=view.width,
        height_px=view.height,
        scale_x_m_px=view.scale_x_m,
        scale_y_m_px=view.scale_y_m,
        centre_x_px=view.centre_x_px,
        centre_y_px=view.centre_y_px,
        rows_grow_with_y=not view.mirrored,
    )
    return task, presses


def our_outputs(run: RunReading, evidence: RunEvidence) -> Outputs | None:
    """Return what the run's replay gives; None where it was not replayed."""
    store = run.store
    if REPLAY_NAME not in store.replays():
        return None
    replay = readable(lambda: store.load_replay(REPLAY_NAME))
    if replay is None:
        return None
    heights: dict[int, FloatArray] = {}
    pressures: dict[int, FloatArray] = {}
    shears: dict[int, FloatArray] = {}
    x_m, y_m = sensor_of(store.config).camera.pad_grid()
    for trial in replay.trials:
        kept = readable(partial(store.load_replay_fields, REPLAY_NAME, trial.index))
        if kept is not None and {"loaded_m", "rest_m"} <= set(kept.height):
            heights[trial.index] = np.asarray(kept.height["loaded_m"] - kept.height["rest_m"])
        pressure = None if kept is None else pressure_at(kept.fields, x_m, y_m)
        if pressure is not None:
            pressures[trial.index] = pressure
        shear = None if kept is None else shear_at(kept.fields, x_m, y_m)
        if shear is not None:
            shears[trial.index] = shear
    return outputs_of_replay(evidence, _who(replay), heights, pressures, shears)


def _who(replay: Replay) -> Simulator:
    model = replay.model
    return Simulator(
        name=OURS,
        version=replay.versions.get("tacauchy-rig", __version__),
        milliseconds_an_image=_milliseconds(replay.trials),
        machine=f"{model.device}, {machine()}",
        note=f"Replay of the measured forces, preset {model.preset}; its time is the search for "
        "the force, on meshes that bound its error, and the image.",
    )


def _milliseconds(trials: tuple[ReplayTrial, ...]) -> float | None:
    """Return how long a press took from its force to its image [ms]."""
    known = [t.wall_s for t in trials if IMAGE_S in t.wall_s]
    total = sum(sum(wall.values()) for wall in known)
    return 1e3 * total / len(known) if known and math.isfinite(total) else None
