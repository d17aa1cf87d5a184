"""From a recorded run to its replay: the simulator presses until it meets each measured force."""

import math
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np

from reports.evidence.evidence_types import TrialImages
from reports.evidence.frames_and_curves import AttemptReading, RunReading
from reports.figures.trial_axis import spread
from reports.scores.residual_causes import Cause, Mode, split_residual
from sim.effects.planned_effects import full_plan
from sim.effects.press_with_effects import path_for
from sim.error_estimate import Tolerance
from sim.fields.npz_and_vtu import SurfaceState, surface_state
from sim.optics.markers.marker_tracking import find_markers
from sim.scene.indenter import MeshIndenter
from sim.scene.scene import Preset
from sim.tilt_sensitivity import COARSE, can_tilt
from tacauchy_rig.app.replay.chosen_optics import (
    Calibrate,
    OpticalCalibration,
    Say,
    optics_of,
    say_nothing,
)
from tacauchy_rig.app.replay.input_uncertainty import NEARLY_UPRIGHT, force_inputs, rounded_rim
from tacauchy_rig.app.replay.press_grouping import (
    Part,
    measured_attempts,
    measured_records,
    parts_of,
    some_of_each,
    tools_of,
)
from tacauchy_rig.app.replay.pressed_parts import PROBES_NAME, press_together, replay_parts
from tacauchy_rig.app.replay.rendering import image_of, rendered
from tacauchy_rig.app.replay.simulator_inputs import ReplayInputs, check_optics
from tacauchy_rig.app.replay.tilt_and_place import find_offset, mounted, offset_of
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.config.settings import PoseSource, RigConfig
from tacauchy_rig.core.config.stated_uncertainty import stated_uncertainty
from tacauchy_rig.core.errors import RigError
from tacauchy_rig.core.parallel import worker_process
from tacauchy_rig.core.simulated import REPLAY_NAME, ForceInput, FoundValue, Replay, ResidualSplit
from tacauchy_rig.core.store.run_store import ReplayFields

MOST_TRIALS, _MOST_PARTS = 12, 6
"""Trials that are pressed again, spread evenly over the forces: each takes two seconds."""
# Steps: large against the scatter of a coarse mesh, small against the curvature of the response
# (steps half as large find half of a planted tilt or modulus).
_MORE = 1.15
_TILT_RAD = math.radians(1.0)
_POISSON = -0.02
# Assumed standard uncertainties: of a lamp's brightness by ageing or another exposure, of light
# drifting within a press, of the lens's blur and of the scale since the calibration.
_LAMP, _DRIFT, _BLUR_PX, _SCALE = 0.1, 0.02, 0.3, 0.01
_UNIFORM = 1.0 / math.sqrt(3.0)
_COLOURS = ("red", "green", "blue")

Images = dict[int, FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True)
class SplitPart:
    """Trials of one indenter at one place."""

    attempts: Sequence[AttemptReading]
    inputs: ReplayInputs  # of the replay, with the modulus that it was pressed with
    # Simulated forces, used for trials without a measured one [N]
    forces_n: Mapping[int, float] = field(default_factory=dict)


def split_images(
    parts: Sequence[SplitPart],
    images: Mapping[int, ImageArray],
    optics: OpticalCalibration,
    config: RigConfig,
    *,
    on_progress: Say,
) -> ResidualSplit | None:
    """Split the residual of a replay's images by its causes; None where that is not possible.

    Args:
        parts: Each has its own coarse presses; the unknowns are common to all.
    """
    pressable = [part for part in parts if not isinstance(part.inputs.indenter, MeshIndenter)]
    if len(pressable) < len(parts):
        on_progress("  the residual is not split for mesh indenters: their presses take minutes")
    found = [(part.inputs, own) for part in pressable if (own := _presses(part, images))]
    chosen = spread(found, _MOST_PARTS)
    again = [
        _Again(spread(presses, MOST_TRIALS // len(chosen)), inputs, optics, config, on_progress)
        for inputs, presses in chosen
    ]
    seen = {press.index: press.images for part in again for press in part.presses}
    view, offset_m = optics.geometry, stated_uncertainty(config, "offset").value
    try:
        return split_residual(
            seen,
            {index: image for index, image in images.items() if index in seen},
            (mode for part in again for mode in part.modes()),
            pose_px=(offset_m / view.scale_x_m, offset_m / view.scale_y_m),
        )
    except RigError as error:
        on_progress(f"  the residual is not split because a coarse press failed: {error.message}")
        return None


@dataclass(frozen=True, slots=True)
class _Press:
    """A trial's force [N] and images; ``bare`` is its no-contact frame without markers."""

    index: int
    force_n: float
    images: TrialImages
    bare: ImageArray


def _presses(part: SplitPart, images: Mapping[int, ImageArray]) -> list[_Press]:
    """Return the presses of a part that can be pressed again, the smallest force first."""
    found = []
    for attempt in part.attempts:
        record = attempt.record
        force_n = record.force_measured_n or part.forces_n.get(record.index, 0.0)
        if force_n <= 0.0 or record.index not in images or attempt.images is None:
            continue
        reference = attempt.images.reference
        markers = find_markers(reference)
        bare = reference if markers is None else markers.bare
        found.append(_Press(record.index, force_n, attempt.images, bare))
    return sorted(found, key=lambda press: press.force_n)


@dataclass(frozen=True, slots=True)
class _Again:
    """The presses of a run again, coarsely, the smallest force first."""

    presses: Sequence[_Press]
    inputs: ReplayInputs
    optics: OpticalCalibration
    config: RigConfig
    on_progress: Say

    def modes(self) -> Iterator[Mode]:
        """Yield every mode."""
        self.on_progress(f"  {len(self.presses)} images: coarse presses with other forces")
        forces_n = [press.force_n for press in self.presses]
        tried = sorted({f * by for f in forces_n for by in (1.0 / _MORE, 1.0, _MORE)})
        upright = self._pressed(self.inputs.tilted(NEARLY_UPRIGHT, 0.0), tried)
        pressed = dict(zip(tried, upright, strict=True))
        less, even, more = ([pressed[f * by] for f in forces_n] for by in (1.0 / _MORE, 1.0, _MORE))
        base = self._seen(even)
        by_force = _apart(self._seen(more), self._seen(less), 1.0 / (_MORE - 1.0 / _MORE))
        yield from self._of_force(by_force)
        self.on_progress("  coarse presses with another Poisson's ratio and other tilts")
        yield from self._of_material(by_force, base)
        if can_tilt(self.inputs.indenter):
            yield from self._of_tilt()
        change = {press.index: base[press.index] - press.bare for press in self.presses}
        self.on_progress("  images with other lamps, blur and scale")
        yield from self._of_light(change)
        yield from self._of_optics(change, even, base)

    def _of_force(self, by_force: Images) -> Iterator[Mode]:
        """Yield errors of the force: in proportion, the same in all trials, of one trial."""
        scale = stated_uncertainty(self.config, "force_scale").value
        yield Mode("force, in proportion", Cause.FORCE, scale, "1", _times(by_force, scale))
        zero_n = _UNIFORM * self.config.protocol.drift
        of_zero = {p.index: zero_n / p.force_n * by_force[p.index] for p in self.presses}
        yield Mode("force, all trials alike", Cause.FORCE, zero_n, "N", of_zero)
        for index, changed in of_zero.items():
            yield Mode(f"force of trial {index}", Cause.FORCE, zero_n, "N", {index: changed})

    def _of_material(self, by_force: Images, base: Images) -> Iterator[Mode]:
        """Yield modulus and Poisson's ratio; a stiffer gel answers like a smaller force."""
        sensor = self.inputs.sensor
        young = sensor.young_uncertainty()[0]
        yield Mode("modulus", Cause.MATERIAL, young, "1", _times(by_force, -young))
        ratio = sensor.least_certain_poisson.uncertainty
        other = replace(
            self.inputs.tilted(NEARLY_UPRIGHT, 0.0), sensor=sensor.with_poisson(_POISSON)
        )
        changed = _apart(self._seen(self._pressed(other)), base, ratio / _POISSON)
        yield Mode("Poisson's ratio", Cause.MATERIAL, ratio, "1", changed)

    def _of_tilt(self) -> Iterator[Mode]:
        size = stated_uncertainty(self.config, "tilt").value
        for name, (x, y) in (("x", (_TILT_RAD, 0.0)), ("y", (0.0, _TILT_RAD))):
            there, back = (
                self._seen(self._pressed(self.inputs.tilted(sign * x, sign * y)))
                for sign in (1, -1)
            )
            changed = _apart(there, back, 0.5 * size / _TILT_RAD)
            yield Mode(f"lean towards {name}", Cause.TILT, size, "rad", changed)

    def _of_light(self, change: Images) -> Iterator[Mode]:
        """Yield lamps of another brightness, and light that drifts from frame to frame."""
        for k, colour in enumerate(_COLOURS):
            only = np.eye(3)[k]
            lamp = {i: _LAMP * only * each for i, each in change.items()}
            yield Mode(f"{colour} lamp", Cause.LIGHT, _LAMP, "1", lamp)
            drift = {press.index: _DRIFT * only * press.bare for press in self.presses}
            since = f"{colour} light since the no-contact frame"
            yield Mode(since, Cause.LIGHT, _DRIFT, "1", drift)

    def _of_optics(
        self, change: Images, surfaces: Sequence[SurfaceState], base: Images
    ) -> Iterator[Mode]:
        """Yield gradients of brightness over the image, the lens's blur, and the scale."""
        view = self.optics.geometry
        for name, count, axis in (("x", view.width, 1), ("y", view.height, 0)):
            along = np.expand_dims(np.linspace(-1.0, 1.0, count), (2, 1 - axis))
            for k, colour in enumerate(_COLOURS):
                bent = {i: _LAMP * np.eye(3)[k] * along * each for i, each in change.items()}
                yield Mode(f"{colour} lamp along {name}", Cause.OPTICS, _LAMP, "1", bent)
        blurred = replace(self.optics, blur_px=self.optics.blur_px + _BLUR_PX)
        changed = _apart(self._seen(surfaces, blurred), base, 1.0)
        yield Mode("blur", Cause.OPTICS, _BLUR_PX, "px", changed)
        for name in "xy":
            wide = {f"scale_{name}_m": getattr(view, f"scale_{name}_m") * (1.0 + _SCALE)}
            scaled = replace(self.optics, geometry=replace(view, **wide))
            changed = _apart(self._seen(surfaces, scaled), base, 1.0)
            yield Mode(f"scale along {name}", Cause.OPTICS, _SCALE, "1", changed)

    def _pressed(
        self, inputs: ReplayInputs, forces_n: Sequence[float] | None = None
    ) -> list[SurfaceState]:
        """Press to rising forces [N]; None is those that were measured."""
        measured = [press.force_n for press in self.presses]
        plain = replace(inputs, sensor=inputs.sensor.relaxing(()), tolerance=None)
        # One mesh for all: under a ball it follows the largest force.
        scene = plain.scene([_MORE * measured[-1]])
        coarse = replace(
            scene,
            indenter=rounded_rim(scene.indenter),
            preset=Preset.FAST,
            refinement=COARSE,
            outputs=frozenset(),
        )
        path = path_for(coarse, full_plan(coarse))
        return [surface_state(path, path.push(force_n)) for force_n in forces_n or measured]

    def _seen(
        self, surfaces: Sequence[SurfaceState], optics: OpticalCalibration | None = None
    ) -> Images:
        sensor, seen = self.inputs.sensor, optics or self.optics
        return {
            press.index: image_of(surface, sensor, seen, unloaded=press.bare).astype(np.float64)
            for press, surface in zip(self.presses, surfaces, strict=True)
        }


def _times(images: Images, factor: float) -> Images:
    return {index: factor * image for index, image in images.items()}


def _apart(images: Images, others: Images, factor: float) -> Images:
    return {index: factor * (image - others[index]) for index, image in images.items()}


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
    on_progress: Say = say_nothing,
) -> Replay:
    """Replay every trial of a run that has a measured force, and keep fields and images.

    Args:
        tolerance: Largest error of F_z; overrides the configured preset.
        optics_file: Calibration in place of the configured one.
        calibrate: How the sensor is calibrated where there is no calibration file; without it the
            file's nominal lamps are used. One part is pressed before it is called.

    Raises:
        RecordError: No trial has a measured force.
        ConfigError: No preset keeps the tolerance, there are no optics to render with, or an
            indenter does not exist.
        ConvergenceError: A force cannot be reached.
    """
    config, parts = run.store.config, parts_of(run, tolerance=tolerance)
    sensor = parts[0].inputs.sensor
    given = config.sensor.optics_calibration if optics_file is None else str(optics_file)
    check_optics(config, sensor, given)
    measured_records(run)  # refuses a run without any, before anything is simulated
    parts = [part for part in parts if part.records]
    are_many, say_once = len(parts) > 1, cache(on_progress)

    @cache
    def optics() -> OpticalCalibration:
        return optics_of(given, sensor, calibrate=calibrate, on_progress=on_progress)

    def replayed(
        parts: Sequence[Part], name: str = REPLAY_NAME, afterwards_s: float = 0.0
    ) -> _Replayed:
        if are_many:
            return replay_parts(
                run, parts, optics(), name=name, afterwards_s=afterwards_s, on_progress=on_progress
            ), {}
        pressed = press_together(parts[0], on_progress=on_progress)
        replay, files = rendered(measured_attempts(run), sensor, *pressed, optics())
        return [replay], files

    tilts = [
        mounted([run.read(r) for r in part.records], part.inputs, config, on_progress=say_once)
        for part in parts
    ]
    parts = [replace(part, inputs=tilt.inputs) for part, tilt in zip(parts, tilts, strict=True)]
    places: list[tuple[FoundValue, ...]] = [()] * len(parts)
    done: _Replayed | None = None
    if config.replay.pose is PoseSource.FOUND:
        some = parts
        if are_many:
            on_progress("finding the place of each indenter from some of its presses")
            some = [parts[k] for k in some_of_each(parts)]
        done = replayed(some, PROBES_NAME)
        places = _found_places(run, parts, _images(run, *done, PROBES_NAME), optics())
        moves = [offset_of(place) for place in places]
        if not are_many and moves[0] is not None:
            on_progress("  images show the contact at another place: pressing again there")
        if are_many or moves[0] is not None:
            done = None
        parts = [
            replace(part, inputs=part.inputs.moved(by_m or (0.0, 0.0)))
            for part, by_m in zip(parts, moves, strict=True)
        ]
    afterwards_s = _AFTERWARDS_S * len(list(tools_of(parts)))
    replays, files = done or replayed(parts, afterwards_s=afterwards_s)
    found = [(*tilt.values, *place) for tilt, place in zip(tilts, places, strict=True)]
    images = _images(run, replays, files)
    inputs, residual = _uncertainties(run, parts, found, replays, images, optics(), on_progress)
    models = [
        replace(
            each.model,
            found=values,
            found_offset_m=offset_of(place) or (0.0, 0.0),
            effects=(*each.model.effects, *tilt.effects),
            force_inputs=tried_inputs,
            trials=part.trials if are_many else (),
        )
        for part, each, values, place, tilt, tried_inputs in zip(
            parts, replays, found, places, tilts, inputs, strict=True
        )
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


def _found_places(
    run: RunReading,
    parts: Sequence[Part],
    images: dict[int, ImageArray],
    optics: OpticalCalibration,
) -> list[tuple[FoundValue, ...]]:
    """Return how far from its place the images show the contact, for each part.

    All stated places of a tool share one shift. Places that are not stated say nothing of others.
    """
    found: list[tuple[FoundValue, ...]] = [()] * len(parts)
    for numbers in tools_of(parts):
        own = [parts[k] for k in numbers]
        stated = [part for part in own if part.place_known] or own
        attempts = [run.read(record) for part in stated for record in part.records]
        values = find_offset(attempts, images, optics.geometry, run.store.config)
        for k in numbers:
            found[k] = values
    return found


def _uncertainties(
    run: RunReading,
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
    config = run.store.config
    on_progress("computing the effect of uncertain inputs on the force")
    with worker_process() as worker:
        jobs: dict[int, Future[tuple[ForceInput, ...]]] = {}
        for numbers in tools_of(parts):
            deepest = max(numbers, key=lambda k: max(parts[k].depths_m, default=0.0))
            depths_m = [depth_m for k in numbers for depth_m in parts[k].depths_m]
            job = worker.submit(
                force_inputs, parts[deepest].inputs, config, depths_m, found[deepest]
            )
            jobs |= dict.fromkeys(numbers, job)
        on_progress("estimating the causes of the image residual")
        split = [
            SplitPart(
                attempts=[run.read(record) for record in part.records],
                inputs=part.inputs.stiffer(replay.model.modulus_factor or 1.0),
                forces_n={trial.index: trial.force_simulated_n for trial in replay.trials},
            )
            for part, replay in zip(parts, replays, strict=True)
        ]
        residual = split_images(split, images, optics, config, on_progress=on_progress)
        return [jobs[k].result() for k in range(len(parts))], residual
