"""From a recorded run to its replay: the simulator presses until it meets each measured force."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from reports.evidence.attempt import RunReading
from sim.error import Tolerance
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
from tacauchy_rig.app.replay.places import replay_parts, tools_of
from tacauchy_rig.app.replay.pressing import (
    has_measured,
    measured_attempts,
    measured_depths,
    mounted,
    press_together,
)
from tacauchy_rig.app.replay.rendering import rendered
from tacauchy_rig.app.replay.settings import check_optics
from tacauchy_rig.app.replay.uncertainty import force_inputs
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.config.model import PoseSource
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.parallel import worker_process
from tacauchy_rig.core.simulated import (
    REPLAY_NAME,
    ForceInput,
    FoundValue,
    Replay,
    ResidualSplit,
)
from tacauchy_rig.core.store.replay_files import ReplayFields

_AFTERWARDS_S = 60.0
"""Processor time of the coarse presses of an indenter, for uncertainties and the residual [s]."""
_PROBES = 4
"""Presses of an indenter that tell where its place is, about."""
_Files = dict[int, ReplayFields]
"""Arrays and images by trial that are not on disk yet."""


def replay_run(
    run: RunReading,
    *,
    tolerance: Tolerance | None = None,
    optics_file: Path | None = None,
    calibrate: Calibrate | None = None,
    on_progress: Say = say_nothing,
) -> Replay:
    """Replay every trial of a run that has a measured force, and keep fields and images.

    Args:
        run: The run; the replay is written into its folder.
        tolerance: Take the cheapest preset that keeps it, whatever is configured.
        optics_file: Calibration in place of the configured one.
        calibrate: How the sensor is calibrated where there is no calibration file; without it the
            file's nominal lamps are used. It is called after pressing.
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
    given = config.sensor.optics_calibration if optics_file is None else str(optics_file)
    check_optics(config, sensor, given)
    measured_attempts(run)  # refuses a run without any, before anything is simulated
    parts = [part for part in parts if has_measured(part.run)]
    told: set[str] = set()

    def say_once(text: str) -> None:
        if text not in told:
            told.add(text)
            on_progress(text)

    tilts = [mounted(each.run, each.inputs, on_progress=say_once) for each in parts]
    parts = [replace(part, inputs=tilt.inputs) for part, tilt in zip(parts, tilts, strict=True)]
    places: list[tuple[FoundValue, ...]] = [()] * len(parts)
    is_found = config.replay.pose is PoseSource.FOUND
    files: _Files = {}
    if len(parts) > 1:
        optics = optics_of(given, sensor, calibrate=calibrate, on_progress=on_progress)
        if is_found:
            on_progress("finding the place of each indenter from some of its presses")
            some = [
                parts[k] for own in tools_of(parts) for k in own[:: max(1, len(own) // _PROBES)]
            ]
            tried = replay_parts(some, optics, on_progress=on_progress)
            places = _found_places(parts, _images(run, tried, {}), optics)
            parts = _moved(parts, places)
        after_s = _AFTERWARDS_S * len(list(tools_of(parts)))
        replays = replay_parts(parts, optics, afterwards_s=after_s, on_progress=on_progress)
    else:
        with ThreadPoolExecutor(1) as reader:  # decoding needs no Python, and pressing hardly any
            reader.submit(_read_frames, run)
            pressed = press_together(parts[0].task, on_progress=on_progress)
        optics = optics_of(given, sensor, calibrate=calibrate, on_progress=on_progress)
        attempts = measured_attempts(parts[0].run)
        first, files = rendered(attempts, sensor, *pressed, optics)
        if is_found:
            places = _found_places(parts, _images(run, [first], files), optics)
            if offset_of(places[0]) is not None:
                on_progress("  images show the contact at another place: pressing again there")
                parts = _moved(parts, places)
                pressed = press_together(parts[0].task, on_progress=on_progress)
                first, files = rendered(attempts, sensor, *pressed, optics)
        replays = [first]
    replays = [
        replace(each, model=replace(each.model, found_offset_m=offset_of(place) or (0.0, 0.0)))
        for each, place in zip(replays, places, strict=True)
    ]
    found = [(*tilt.values, *place) for tilt, place in zip(tilts, places, strict=True)]
    images = _images(run, replays, files)
    inputs, residual = _uncertainties(parts, found, replays, images, optics, on_progress)
    models = [
        replace(
            each.model,
            found=values,
            effects=(*each.model.effects, *tilt.effects),
            force_inputs=tried_inputs,
            trials=tuple(part.run.records) if len(parts) > 1 else (),
        )
        for part, each, values, tilt, tried_inputs in zip(
            parts, replays, found, tilts, inputs, strict=True
        )
    ]
    trials = sorted((t for each in replays for t in each.trials), key=lambda trial: trial.index)
    replay = replace(
        replays[0],
        trials=tuple(trials),
        model=replace(models[0], residual=residual),
        others=tuple(models[1:]),
    )
    store.save_replay(replay, files)
    return replay


def _read_frames(run: RunReading) -> None:
    """Read the frames that images are rendered over and held against."""
    for attempt in measured_attempts(run):
        with suppress(RecordError):  # raised again when the frames are used
            _ = attempt.reference, attempt.images


def _images(run: RunReading, replays: Sequence[Replay], files: _Files) -> dict[int, ImageArray]:
    """Return the rendered image of each trial, from memory or from disk."""
    found = {}
    for trial in (trial for each in replays for trial in each.trials):
        own = files.get(trial.index)
        image = (
            run.store.load_replay_fields(REPLAY_NAME, trial.index).image
            if own is None
            else own.image
        )
        if image is not None:
            found[trial.index] = image
    return found


def _moved(parts: Sequence[Part], places: Sequence[tuple[FoundValue, ...]]) -> list[Part]:
    """Return parts where images show their contacts."""
    return [
        replace(part, inputs=part.inputs.moved(offset_of(place) or (0.0, 0.0)))
        for part, place in zip(parts, places, strict=True)
    ]


def _found_places(
    parts: Sequence[Part], images: dict[int, ImageArray], optics: OpticalCalibration
) -> list[tuple[FoundValue, ...]]:
    """Return how far from its place the images show the contact, for each part.

    All stated places of a tool share one shift. Places that are not stated say nothing of others.
    """
    found: list[tuple[FoundValue, ...]] = [()] * len(parts)
    for numbers in tools_of(parts):
        own = [parts[k] for k in numbers]
        stated = [part for part in own if part.place_known] or own
        attempts = [attempt for part in stated for attempt in measured_attempts(part.run)]
        values = find_offset(attempts, images, optics.geometry, own[0].run.store.config)
        for k in numbers:
            found[k] = values
    return found


def _uncertainties(
    parts: Sequence[Part],
    found: Sequence[tuple[FoundValue, ...]],
    replays: Sequence[Replay],
    images: dict[int, ImageArray],
    optics: OpticalCalibration,
    on_progress: Say,
) -> tuple[list[tuple[ForceInput, ...]], ResidualSplit | None]:
    """Return what uncertain inputs change of each part's forces, and what splits the residual.

    Both are coarse presses; the former go to a worker process meanwhile. They are tried once for
    each indenter, where it was pressed deepest: the place hardly matters.
    """
    config = parts[0].run.store.config
    on_progress("trying what uncertain inputs change of the force")
    with worker_process() as worker:
        tried = []
        for numbers in tools_of(parts):
            depths = {k: measured_depths(parts[k].run) for k in numbers}
            deepest = max(numbers, key=lambda k: max(depths[k], default=0.0))
            every = [depth for own in depths.values() for depth in own]
            part = parts[deepest]
            job = worker.submit(
                force_inputs, part.inputs, part.run.store.config, every, found[deepest]
            )
            tried.append((numbers, job))
        on_progress("trying what the images' residual is made of")
        split = [
            SplitPart(
                attempts=measured_attempts(part.run),
                inputs=part.inputs.stiffer(replay.model.modulus_factor or 1.0),
                forces_n={trial.index: trial.force_simulated_n for trial in replay.trials},
            )
            for part, replay in zip(parts, replays, strict=True)
        ]
        residual = split_images(split, images, optics, config, on_progress=on_progress)
        inputs: list[tuple[ForceInput, ...]] = [()] * len(parts)
        for numbers, job in tried:
            for k in numbers:
                inputs[k] = job.result()
        return inputs, residual
