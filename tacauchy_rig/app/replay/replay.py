"""From a recorded run to its replay: the simulator presses until it meets each measured force."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace

from reports.evidence.attempt import RunReading
from sim.error.tolerance import Tolerance
from sim.fields.press_fields import TrialFields
from sim.sensor.sensor import Sensor
from tacauchy_rig.app.replay.image_causes import SplitPart, split_images
from tacauchy_rig.app.replay.mounting import find_offset, offset_of
from tacauchy_rig.app.replay.optics import (
    Calibrate,
    OpticalCalibration,
    Say,
    optics_of,
    say_nothing,
)
from tacauchy_rig.app.replay.parts import Part, parts_of
from tacauchy_rig.app.replay.pressing import (
    Pressed,
    is_measured,
    measured_attempts,
    measured_depths,
    mounted,
    press_parts,
)
from tacauchy_rig.app.replay.rendering import intermediate_arrays, render_trial
from tacauchy_rig.app.replay.settings import check_optics
from tacauchy_rig.app.replay.uncertainty import force_inputs
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.config.model import PoseSource
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.side_by_side import worker_process
from tacauchy_rig.core.simulated import IMAGE_S, FoundValue, Replay, ReplayModel, ResidualSplit
from tacauchy_rig.core.store.replay_files import ReplayFields

Rendered = tuple[Replay, dict[int, ReplayFields]]


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
            file; without it the file's nominal lamps are used. It is called after pressing.
        on_progress: Told of every step.

    Raises:
        RecordError: No trial has a measured force.
        ConfigError: No preset keeps the tolerance, there are no optics to render with, or an
            indenter does not exist.
        ConvergenceError: A force cannot be reached.
    """
    store, config = run.store, run.store.config
    parts = parts_of(run, tolerance=tolerance)
    sensor = parts[0].inputs.sensor
    check_optics(config, sensor)
    parts = _with_presses(run, parts)
    mountings = [mounted(each.run, each.inputs, on_progress=on_progress) for each in parts]
    parts = [
        replace(part, inputs=found.inputs) for part, found in zip(parts, mountings, strict=True)
    ]
    with ThreadPoolExecutor(1) as reader:  # decoding needs no Python, and pressing hardly any
        reader.submit(_read_frames, run)
        pressed = press_parts(parts, on_progress=on_progress)
    given = config.sensor.optics_calibration
    optics = optics_of(given, sensor, calibrate=calibrate, on_progress=on_progress)
    places, parts, rendered = _drawn(parts, pressed, optics, on_progress)
    on_progress("trying what uncertain inputs change of the force")
    values = [(*found.values, *places) for found in mountings]
    with worker_process() as worker:
        tried = [
            worker.submit(force_inputs, part.inputs, config, measured_depths(part.run), found=known)
            for part, known in zip(parts, values, strict=True)
        ]
        residual = _residual(parts, rendered, optics, on_progress)
        inputs = [each.result() for each in tried]
    models = [
        replace(
            replay.model,
            found=known,
            effects=(*replay.model.effects, *found.effects),
            force_inputs=tried_inputs,
            trials=tuple(part.run.records) if len(parts) > 1 else (),
        )
        for part, (replay, _), known, found, tried_inputs in zip(
            parts, rendered, values, mountings, inputs, strict=True
        )
    ]
    replay = _together([replay for replay, _ in rendered], models, residual)
    store.save_replay(replay, {i: kept for _, by_trial in rendered for i, kept in by_trial.items()})
    return replay


def _read_frames(run: RunReading) -> None:
    """Read the frames that images are rendered over and held against."""
    for attempt in measured_attempts(run):
        with suppress(RecordError):  # asked for again, it says so
            _ = attempt.reference, attempt.images


def _with_presses(run: RunReading, parts: Sequence[Part]) -> list[Part]:
    """Return the parts that have something to press to.

    Raises:
        RecordError: None has.
    """
    measured_attempts(run)
    return [
        part
        for part in parts
        if any(record and is_measured(record, run) for record in part.run.records.values())
    ]


def _drawn(
    parts: list[Part], pressed: list[Pressed], optics: OpticalCalibration, on_progress: Say
) -> tuple[tuple[FoundValue, ...], list[Part], list[Rendered]]:
    """Render what was pressed, again where images show the contact if that is asked for.

    Returns:
        What was found of the place, the parts that were pressed at last, and what is seen of each.
    """
    rendered = _rendered(parts, pressed, optics)
    places: tuple[FoundValue, ...] = ()
    if parts[0].run.store.config.replay.pose is PoseSource.FOUND:
        places, parts, again = _where_seen(parts, rendered, optics, on_progress)
        if again is not None:
            pressed, rendered = again
    passed = [
        _with_passed(part, each, fields, optics)
        for part, each, (_, fields) in zip(parts, rendered, pressed, strict=True)
    ]
    return places, parts, passed


def _rendered(
    parts: Sequence[Part], pressed: Sequence[Pressed], optics: OpticalCalibration
) -> list[Rendered]:
    return [
        render_again(part.run, part.inputs.sensor, *each, optics)
        for part, each in zip(parts, pressed, strict=True)
    ]


def _images(rendered: Sequence[Rendered]) -> dict[int, ImageArray]:
    return {
        index: made.image
        for _, kept in rendered
        for index, made in kept.items()
        if made.image is not None
    }


def _where_seen(
    parts: Sequence[Part],
    rendered: list[Rendered],
    optics: OpticalCalibration,
    on_progress: Say,
) -> tuple[tuple[FoundValue, ...], list[Part], tuple[list[Pressed], list[Rendered]] | None]:
    """Press again where images show the contact, if that is beside the stated place.

    All stated places are beside by as much: what lies there is the pad. Places that are not stated
    tell nothing of others.
    """
    stated = [part for part in parts if part.place_known] or parts
    attempts = [attempt for part in stated for attempt in measured_attempts(part.run)]
    config = parts[0].run.store.config
    values = find_offset(attempts, _images(rendered), optics.geometry, config)
    at = offset_of(values)
    if at is None:
        return values, list(parts), None
    on_progress("  images show the contact beside its stated place: pressing again there")
    moved = [replace(part, inputs=part.inputs.moved(at)) for part in parts]
    pressed = press_parts(moved, on_progress=on_progress)
    again = [
        (replace(replay, model=replace(replay.model, found_offset_m=at)), kept)
        for replay, kept in _rendered(moved, pressed, optics)
    ]
    return values, moved, (pressed, again)


def _with_passed(
    part: Part,
    rendered: Rendered,
    fields: Mapping[int, TrialFields],
    optics: OpticalCalibration,
) -> Rendered:
    """Add what is seen on the way to each force."""
    replay, kept = rendered
    passed = intermediate_arrays(measured_attempts(part.run), part.inputs.sensor, fields, optics)
    return replay, {i: replace(each, passed=passed.get(i, {})) for i, each in kept.items()}


def _residual(
    parts: Sequence[Part],
    rendered: Sequence[Rendered],
    optics: OpticalCalibration,
    on_progress: Say,
) -> ResidualSplit | None:
    """Say what the residual of a replay's images is made of, trying each cause coarsely."""
    on_progress("trying what the images' residual is made of")
    split = [
        SplitPart(
            attempts=measured_attempts(part.run),
            inputs=replace(
                part.inputs,
                sensor=part.inputs.sensor.stiffer(replay.model.modulus_factor or 1.0),
            ),
            forces_n={trial.index: trial.force_simulated_n for trial in replay.trials},
        )
        for part, (replay, _) in zip(parts, rendered, strict=True)
    ]
    config = parts[0].run.store.config
    return split_images(split, _images(rendered), optics, config, on_progress=on_progress)


def _together(
    replays: Sequence[Replay], models: Sequence[ReplayModel], residual: ResidualSplit | None
) -> Replay:
    """Return the replays of all parts as one; the first model says what images are made of."""
    trials = sorted((t for each in replays for t in each.trials), key=lambda trial: trial.index)
    first, *others = models
    return replace(
        replays[0],
        trials=tuple(trials),
        model=replace(first, residual=residual),
        others=tuple(others),
    )


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
