"""From a recorded run to its replay: the simulator presses until it meets each measured force."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace

from reports.evidence.attempt import RunReading
from sim.error import Tolerance
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
    has_measured,
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
from tacauchy_rig.core.parallel import worker_process
from tacauchy_rig.core.simulated import (
    IMAGE_S,
    ForceInput,
    FoundValue,
    Replay,
    ResidualSplit,
)
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
    measured_attempts(run)  # refuses a run without any, before anything is simulated
    parts = [part for part in parts if has_measured(part.run)]
    tilts = [mounted(each.run, each.inputs, on_progress=on_progress) for each in parts]
    parts = [replace(part, inputs=tilt.inputs) for part, tilt in zip(parts, tilts, strict=True)]
    with ThreadPoolExecutor(1) as reader:  # decoding needs no Python, and pressing hardly any
        reader.submit(_read_frames, run)
        pressed = press_parts(parts, on_progress=on_progress)
    given = config.sensor.optics_calibration
    optics = optics_of(given, sensor, calibrate=calibrate, on_progress=on_progress)
    rendered = _rendered(parts, pressed, optics)
    place: tuple[FoundValue, ...] = ()
    if config.replay.pose is PoseSource.FOUND:
        place = _found_place(parts, rendered, optics)
        offset_m = offset_of(place)
        if offset_m is not None:
            on_progress("  images show the contact at another place: pressing again there")
            parts = [replace(part, inputs=part.inputs.moved(offset_m)) for part in parts]
            pressed = press_parts(parts, on_progress=on_progress)
            rendered = _rendered(parts, pressed, optics, found_offset_m=offset_m)
    found = [(*tilt.values, *place) for tilt in tilts]
    inputs, residual = _uncertainties(parts, found, rendered, optics, on_progress)
    models = [
        replace(
            replay.model,
            found=values,
            effects=(*replay.model.effects, *tilt.effects),
            force_inputs=tried_inputs,
            trials=tuple(part.run.records) if len(parts) > 1 else (),
        )
        for part, (replay, _), values, tilt, tried_inputs in zip(
            parts, rendered, found, tilts, inputs, strict=True
        )
    ]
    trials = sorted((t for each, _ in rendered for t in each.trials), key=lambda trial: trial.index)
    replay = replace(
        rendered[0][0],
        trials=tuple(trials),
        model=replace(models[0], residual=residual),
        others=tuple(models[1:]),
    )
    kept: dict[int, ReplayFields] = {}
    for part, (_, arrays), (_, fields) in zip(parts, rendered, pressed, strict=True):
        states = intermediate_arrays(
            measured_attempts(part.run), part.inputs.sensor, fields, optics
        )
        kept |= {i: replace(each, passed=states.get(i, {})) for i, each in arrays.items()}
    store.save_replay(replay, kept)
    return replay


def _read_frames(run: RunReading) -> None:
    """Read the frames that images are rendered over and held against."""
    for attempt in measured_attempts(run):
        with suppress(RecordError):  # raised again when the frames are used
            _ = attempt.reference, attempt.images


def _rendered(
    parts: Sequence[Part],
    pressed: Sequence[Pressed],
    optics: OpticalCalibration,
    *,
    found_offset_m: tuple[float, float] = (0.0, 0.0),
) -> list[Rendered]:
    rendered = []
    for part, (replay, fields) in zip(parts, pressed, strict=True):
        seen, kept = render_again(part.run, part.inputs.sensor, replay, fields, optics)
        model = replace(seen.model, found_offset_m=found_offset_m)
        rendered.append((replace(seen, model=model), kept))
    return rendered


def _images(rendered: Sequence[Rendered]) -> dict[int, ImageArray]:
    return {
        index: made.image
        for _, kept in rendered
        for index, made in kept.items()
        if made.image is not None
    }


def _found_place(
    parts: Sequence[Part], rendered: Sequence[Rendered], optics: OpticalCalibration
) -> tuple[FoundValue, ...]:
    """Return how far from its place the images show the contact.

    All stated places share one shift, that of the pad. Places that are not stated say nothing of
    others.
    """
    stated = [part for part in parts if part.place_known] or parts
    attempts = [attempt for part in stated for attempt in measured_attempts(part.run)]
    config = parts[0].run.store.config
    return find_offset(attempts, _images(rendered), optics.geometry, config)


def _uncertainties(
    parts: Sequence[Part],
    found: Sequence[tuple[FoundValue, ...]],
    rendered: Sequence[Rendered],
    optics: OpticalCalibration,
    on_progress: Say,
) -> tuple[list[tuple[ForceInput, ...]], ResidualSplit | None]:
    """Return what uncertain inputs change of each part's forces, and what splits the residual.

    Both are coarse presses; the former go to a worker process meanwhile.
    """
    config = parts[0].run.store.config
    on_progress("trying what uncertain inputs change of the force")
    with worker_process() as worker:
        tried = [
            worker.submit(
                force_inputs, part.inputs, part.run.store.config, measured_depths(part.run), values
            )
            for part, values in zip(parts, found, strict=True)
        ]
        on_progress("trying what the images' residual is made of")
        split = [
            SplitPart(
                attempts=measured_attempts(part.run),
                inputs=part.inputs.stiffer(replay.model.modulus_factor or 1.0),
                forces_n={trial.index: trial.force_simulated_n for trial in replay.trials},
            )
            for part, (replay, _) in zip(parts, rendered, strict=True)
        ]
        images = _images(rendered)
        residual = split_images(split, images, optics, config, on_progress=on_progress)
        return [each.result() for each in tried], residual


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
    uncertainty, source = sensor.young_uncertainty()
    model = replace(
        replay.model,
        young_uncertainty_relative=uncertainty,
        young_source=source,
        optics=dict(optics.model.provenance),
        scale_x_m_px=optics.geometry.scale_x_m,
        image_centre_m=optics.geometry.centre_from_middle_m,
        scale_y_m_px=optics.geometry.scale_y_m,
        markers=tuple(trial.markers for trial in rendered.values() if trial.markers is not None),
    )
    kept = {i: trial.kept for i, trial in rendered.items()}
    return replace(replay, trials=trials, model=model), kept
