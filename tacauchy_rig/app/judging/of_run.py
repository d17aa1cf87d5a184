"""What a run asks of simulators, and what its own replay answers as the first of them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from functools import partial
from pathlib import Path

from reports.evidence.attempt import RunReading, readable
from reports.evidence.evidence import RunEvidence
from reports.evidence.replayed import pressure_at, shear_at
from reports.scores.force_agreement import predict
from sim.scene.indenter import describe
from tacauchy_rig import __version__
from tacauchy_rig.app.replay.inputs import inputs_of, sensor_of
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.rgb import encode_png
from tacauchy_rig.core.simulated import (
    IMAGE_S,
    REPLAY_NAME,
    Driven,
    Outputs,
    PressOutput,
    Replay,
    ReplayTrial,
    Simulator,
)
from tacauchy_rig.core.store.durable import write_atomically
from tacauchy_rig.core.versions import machine

OURS = "tacauchy_rig"
TASK, PRESSES, NO_CONTACT = "task.toml", "presses.csv", "no_contact.png"


@dataclass(frozen=True, slots=True, kw_only=True)
class AskedPress:
    """One press; None is not known.

    Attributes:
        depth_m: Below the height at which F_z was ``Task.contact_force_n`` [m].
        place_x_m: Of the tip, in the pad's frame [m].
        indenter: As ``press --indenter`` has it.
    """

    press: int
    force_n: float | None
    depth_m: float | None
    place_x_m: float | None
    place_y_m: float | None
    indenter: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """All presses of a run, and what they share.

    Attributes:
        sensor: Name of its file.
        friction: Coulomb coefficient.
        centre_x_px: Column of the scored image that sees the pad's centre.
        rows_grow_with_y: Rows of the image grow with the pad's y where columns grow with x.
    """

    run: str
    sensor: str
    friction: float
    contact_force_n: float
    width_px: int
    height_px: int
    scale_x_m_px: float
    scale_y_m_px: float
    centre_x_px: float
    centre_y_px: float
    rows_grow_with_y: bool


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
        place = inputs.offset_m if other is None else other.place_m
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


def replay_outputs(run: RunReading, evidence: RunEvidence) -> Outputs | None:
    """Return what the run's replay gives, as of any simulator; None where it was not replayed.

    Forces are those that the stated gel predicts at the measured depths, not the matched ones,
    which agree by construction.
    """
    store = run.store
    if REPLAY_NAME not in store.replays():
        return None
    replay = readable(lambda: store.load_replay(REPLAY_NAME))
    if replay is None:
        return None
    x_m, y_m = sensor_of(store.config).camera.pad_grid()
    presses, missing = {}, []
    for trial in evidence.trials:
        if trial.simulated_image is None and trial.replay is None:
            missing.append(trial.index)
            continue
        kept = readable(partial(store.load_replay_fields, REPLAY_NAME, trial.index))
        heights = {} if kept is None else kept.height
        has_heights = {"loaded_m", "rest_m"} <= heights.keys()
        presses[trial.index] = PressOutput(
            image=trial.simulated_image,
            force_n=predict(trial, evidence.contact_force_n)[0],
            height_m=heights["loaded_m"] - heights["rest_m"] if has_heights else None,
            pressure_pa=None if kept is None else pressure_at(kept.fields, x_m, y_m),
            shear_pa=None if kept is None else shear_at(kept.fields, x_m, y_m),
        )
    return Outputs(simulator=_who(replay), presses=presses, left_out=tuple(missing))


def _who(replay: Replay) -> Simulator:
    model = replay.model
    return Simulator(
        name=OURS,
        version=replay.versions.get("tacauchy-rig", __version__),
        milliseconds_an_image=_milliseconds(replay.trials),
        machine=f"{model.device}, {machine()}",
        driven_by=Driven.DEPTH,
        note=f"Replay of the measured forces, preset {model.preset}; its time is the search for "
        "the force, on meshes that bound its error, and the image.",
    )


def _milliseconds(trials: tuple[ReplayTrial, ...]) -> float | None:
    """Return how long a press took from its force to its image [ms]."""
    known = [t.wall_s for t in trials if IMAGE_S in t.wall_s]
    total = sum(sum(wall.values()) for wall in known)
    return 1e3 * total / len(known) if known and math.isfinite(total) else None


def write_task(
    folder: Path,
    task: Task,
    presses: list[AskedPress],
    references: Mapping[int, ImageArray],
) -> None:
    """Write what a simulator needs to know; SI, units in the names.

    Args:
        references: No-contact frames by press, of the scored size.

    Raises:
        RecordError: The folder cannot be written.
    """
    lines = [f"{key} = {json.dumps(value)}" for key, value in asdict(task).items()]
    write_atomically(folder / TASK, "\n".join([*lines, ""]).encode())
    head = [each.name for each in fields(AskedPress)]
    rows = [",".join(map(_cell, asdict(press).values())) for press in presses]
    write_atomically(folder / PRESSES, "\n".join([",".join(head), *rows, ""]).encode())
    for trial, image in references.items():
        write_atomically(folder / f"{trial:02d}" / NO_CONTACT, encode_png(image))


def _cell(value: object) -> str:
    if value is None:
        return ""
    return f'"{value}"' if isinstance(value, str) else str(value)
