"""From a recorded run to its replay: the simulator presses until it meets each measured force."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import nullcontext
from dataclasses import replace
from functools import cache
from pathlib import Path

from reports.evidence.frames_and_curves import RunReading
from sim.tolerance import Tolerance
from tacauchy_rig.app.replay.chosen_optics import Calibrate, OpticalCalibration, optics_of
from tacauchy_rig.app.replay.pressed_parts import PROBES_NAME, press_together, replay_parts
from tacauchy_rig.app.replay.rendering import rendered
from tacauchy_rig.app.replay.simulator_inputs import (
    Part,
    check_optics,
    measured_attempts,
    measured_records,
    parts_of,
    some_of_each,
    tools_of,
)
from tacauchy_rig.app.replay.tilt_and_place import find_offset, mounted, offset_of
from tacauchy_rig.app.replay.uncertain_inputs import force_inputs, split_images
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.config.settings import PoseSource
from tacauchy_rig.core.parallel import worker_process
from tacauchy_rig.core.simulated import REPLAY_NAME, ForceInput, Replay, ResidualSplit
from tacauchy_rig.core.store.run_store import ReplayFields
from tacauchy_rig.core.time_limit_and_progress import heard, say

_AFTERWARDS_S = 60.0
"""Processor time of the coarse presses of an indenter, for uncertainties and the residual [s]."""
_Replayed = tuple[list[Replay], dict[int, ReplayFields]]
"""Of each part, and arrays and images by trial that are not on disk yet."""


def replay_run(
    run: RunReading,
    *,
    tolerance: Tolerance | None = None,
    optics_file: Path | None = None,
    calibrate: Calibrate | None = None,
    on_progress: Callable[[str], None] | None = None,
) -> Replay:
    """Replay every trial of a run that has a measured force, and keep fields and images.

    Args:
        tolerance: Largest error of F_z; overrides the configured preset.
        optics_file: Calibration in place of the configured one.
        calibrate: How the sensor is calibrated where there is no calibration file; without it the
            file's nominal lamps are used. One part is pressed before it is called.
        on_progress: Told every line of progress.

    Raises:
        RecordError: No trial has a measured force.
        ConfigError: No preset keeps the tolerance, there are no optics to render with, or an
            indenter does not exist.
        ConvergenceError: A force cannot be reached.
    """
    with nullcontext() if on_progress is None else heard(on_progress):
        return _replayed_run(run, tolerance, optics_file, calibrate)


def _replayed_run(
    run: RunReading,
    tolerance: Tolerance | None,
    optics_file: Path | None,
    calibrate: Calibrate | None,
) -> Replay:
    config, parts = run.store.config, parts_of(run, tolerance=tolerance)
    sensor = parts[0].inputs.sensor
    given = config.sensor.optics_calibration if optics_file is None else str(optics_file)
    check_optics(config, sensor, given)
    measured_records(run)  # refuses a run without any, before anything is simulated
    parts = [part for part in parts if part.records]
    are_many = len(parts) > 1

    @cache
    def optics() -> OpticalCalibration:
        return optics_of(given, sensor, calibrate=calibrate)

    def replayed(
        parts: Sequence[Part], name: str = REPLAY_NAME, afterwards_s: float = 0.0
    ) -> _Replayed:
        if are_many:
            return replay_parts(run, parts, optics(), name=name, afterwards_s=afterwards_s), {}
        pressed = press_together(parts[0])
        replay, files = rendered(measured_attempts(run), sensor, *pressed, optics())
        return [replay], files

    parts = [mounted(part, [run.read(r) for r in part.records]) for part in parts]
    rows = [row for part in parts for row in part.effects]
    lines = (f"{row['name']} {'on' if row['on'] else 'left out'}: {row['reason']}" for row in rows)
    for line in dict.fromkeys(lines):
        say(line)
    done: _Replayed | None = None
    if config.replay.pose is PoseSource.FOUND:
        some = parts
        if are_many:
            say("finding the place of each indenter from some of its presses")
            some = [parts[k] for k in some_of_each(parts)]
        done = replayed(some, PROBES_NAME)
        parts = _placed(run, parts, _images(run, *done, PROBES_NAME), optics())
        is_moved = offset_of(parts[0].found) is not None
        if not are_many and is_moved:
            say("  images show the contact at another place: pressing again there")
        if are_many or is_moved:
            done = None
    afterwards_s = _AFTERWARDS_S * len(list(tools_of(parts)))
    replays, files = done or replayed(parts, afterwards_s=afterwards_s)
    images = _images(run, replays, files)
    inputs, residual = _uncertainties(run, parts, replays, images, optics())
    models = [
        replace(
            each.model,
            found=part.found,
            found_offset_m=offset_of(part.found) or (0.0, 0.0),
            effects=(*each.model.effects, *part.effects),
            force_inputs=tried_inputs,
            trials=part.trials if are_many else (),
        )
        for part, each, tried_inputs in zip(parts, replays, inputs, strict=True)
    ]
    replay = replace(
        replays[0],
        trials=tuple(sorted((t for each in replays for t in each.trials), key=lambda t: t.index)),
        model=replace(models[0], residual=residual),
        others=tuple(models[1:]),
    )
    run.store.save_replay(replay, files)
    return replay


def _images(
    run: RunReading,
    replays: Sequence[Replay],
    files: dict[int, ReplayFields],
    name: str = REPLAY_NAME,
) -> dict[int, ImageArray]:
    """Return the rendered image of each trial, from memory or from disk."""
    found = {}
    for index in (trial.index for each in replays for trial in each.trials):
        own = files.get(index) or run.store.load_replay_fields(name, index)
        if own.image is not None:
            found[index] = own.image
    return found


def _placed(
    run: RunReading,
    parts: Sequence[Part],
    images: dict[int, ImageArray],
    optics: OpticalCalibration,
) -> list[Part]:
    """Return the parts where the images show their contacts.

    All stated places of a tool share one shift. Places that are not stated say nothing of others.
    """
    placed = list(parts)
    for numbers in tools_of(parts):
        own = [parts[k] for k in numbers]
        stated = [part for part in own if part.place_known] or own
        attempts = [run.read(record) for part in stated for record in part.records]
        values = find_offset(attempts, images, optics.geometry, run.store.config)
        by_m = offset_of(values) or (0.0, 0.0)
        for k in numbers:
            found = (*parts[k].found, *values)
            placed[k] = replace(parts[k], inputs=parts[k].inputs.moved(by_m), found=found)
    return placed


def _uncertainties(
    run: RunReading,
    parts: Sequence[Part],
    replays: Sequence[Replay],
    images: dict[int, ImageArray],
    optics: OpticalCalibration,
) -> tuple[list[tuple[ForceInput, ...]], ResidualSplit | None]:
    """Return what uncertain inputs change of each part's forces, and what splits the residual.

    Both are coarse presses; the former go to a worker process meanwhile. They are tried once for
    each indenter, where it was pressed deepest: the place hardly matters.
    """
    config = run.store.config
    say("computing the effect of uncertain inputs on the force")
    with worker_process() as worker:
        jobs: dict[int, Future[tuple[ForceInput, ...]]] = {}
        for numbers in tools_of(parts):
            deepest = max(numbers, key=lambda k: max(parts[k].depths_m, default=0.0))
            depths_m = [depth_m for k in numbers for depth_m in parts[k].depths_m]
            part = parts[deepest]
            job = worker.submit(force_inputs, part.inputs, config, depths_m, part.found)
            jobs |= dict.fromkeys(numbers, job)
        say("estimating the causes of the image residual")
        inputs = [
            part.inputs.stiffer(replay.model.modulus_factor or 1.0)
            for part, replay in zip(parts, replays, strict=True)
        ]
        attempts = [[run.read(record) for record in part.records] for part in parts]
        forces_n = {t.index: t.force_simulated_n for replay in replays for t in replay.trials}
        split = list(zip(inputs, attempts, strict=True))
        residual = split_images(split, images, forces_n, optics, config)
        return [jobs[k].result() for k in range(len(parts))], residual
