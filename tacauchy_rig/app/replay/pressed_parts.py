"""Presses at many places: each part is pressed on its own, and kept when it is finished.

A part is pressed in another process and forgotten there, so that memory does not grow with the
number of parts. Pressed surfaces are kept, too: with other optics only images are made again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from reports.evidence.frames_and_curves import RunReading
from reports.evidence.modulus_and_tilt_fit import ModulusFit, fit_modulus
from sim.cheapest_setting import setting_of
from sim.effects.effect_choice import plan_effects
from sim.fields.saved_press import IntermediateState, SurfaceState, TrialFields
from sim.replay import (
    History,
    ReferencePath,
    path_depends_on_modulus,
    reference_path,
    replay_alone,
    replay_forces,
)
from sim.scene.indenter import Cylinder, Sphere
from sim.scene.scene import Target
from tacauchy_rig.app.replay.chosen_optics import OpticalCalibration
from tacauchy_rig.app.replay.rendering import rendered
from tacauchy_rig.app.replay.simulator_inputs import Part, some_of_each, tools_of
from tacauchy_rig.app.replay.tilt_and_place import fits_modulus, tilted_curve
from tacauchy_rig.core.arrays import content_hash
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.parallel import parallel_map
from tacauchy_rig.core.run import TrialRecord
from tacauchy_rig.core.simulated import REPLAY_NAME, ForceDepthCurve, Replay
from tacauchy_rig.core.store.atomic_write import write_atomically
from tacauchy_rig.core.store.json_codec import dumps, read_json
from tacauchy_rig.core.store.run_store import pack_arrays, unpack_arrays, write_fields
from tacauchy_rig.core.time_limit_and_progress import Remaining, doing, heard, say, time_limit

Pressed = tuple[Replay, dict[int, TrialFields]]
"""A replay of which nothing is rendered yet, and fields by trial."""


def press_together(part: Part) -> Pressed:
    """Press to every measured force; if the run asks so, the depths of all trials fit the modulus.

    For a tilted indenter the modulus is fitted with an upright one, corrected by coarse presses of
    both: a tilt breaks the symmetry, and a press with it takes ten times as long. A press without
    a measured force is pressed to its depth.
    """
    say(f"replaying {len(part.records)} trials")
    if not fits_modulus(part.config):
        return press_to_measured(part, None)
    path = _stated_path(part)
    stated = () if path is None else path.history
    fit = modulus_of([(part, stated)])
    if any(part.inputs.tilt_rad):
        return press_to_measured(part, fit)
    return press_to_measured(part, fit, stated, path)


def stated_history(part: Part) -> History:
    """Return (depth [m], force [N]) of the gel with the stated modulus, to the measured forces."""
    alone = _alone(part)
    if alone is not None:
        return alone[0].trials[0].force_history
    path = _stated_path(part)
    return () if path is None else path.history


def modulus_of(simulated: Sequence[tuple[Part, History]]) -> ModulusFit | None:
    """Fit the factor of the gel's modulus to depths and forces of all trials."""
    curves = []
    for part, history in simulated:
        curve = ForceDepthCurve.merged([history])
        is_tilted = any(part.inputs.tilt_rad)
        curves.append((part.records, tilted_curve(curve, part.inputs) if is_tilted else curve))
    fit = fit_modulus(curves, contact_force_n=simulated[0][0].config.protocol.contact_force)
    if fit is None:
        say("  fewer than two trials have both force and depth: the stated modulus is used")
    else:
        say(
            f"  modulus fitted to {fit.trial_count} trials: {fit.factor:.3f} times "
            f"that of the sensor file (standard deviation {fit.factor_deviation:.3f})"
        )
    return fit


def press_to_measured(
    part: Part, fit: ModulusFit | None, stated: History = (), path: ReferencePath | None = None
) -> Pressed:
    """Press to every force, and to the depths of trials without one.

    Args:
        fit: Of the modulus; None takes the stated one.
        stated: (depth [m], force [N]) of the gel with the stated modulus.
        path: The loading path of that gel, where its states may be gone on from.
    """
    stiffer = part if fit is None else replace(part, inputs=part.inputs.stiffer(fit.factor))
    alone = _alone(stiffer)
    if alone is None:
        replay, fields, records = _on_one_path(stiffer, fit, path)
    else:
        replay, fields, records = alone[0], [alone[1]], list(part.records)
    measured = (r.force_measured_n for r in records)
    trials = tuple(
        replace(trial, index=record.index, force_measured_n=math.nan if force is None else force)
        for trial, record, force in zip(replay.trials, records, measured, strict=True)
    )
    model = replay.model
    if fit is not None:
        model = replace(
            model,
            modulus_factor=fit.factor,
            modulus_factor_deviation=fit.factor_deviation,
            modulus_trials=fit.trial_count,
            stated_force_history=stated,
        )
    by_trial = {record.index: found for record, found in zip(records, fields, strict=True)}
    return replace(replay, trials=trials, model=model), by_trial


def _alone(part: Part) -> tuple[Replay, TrialFields] | None:
    """Press the one trial of a part on a mesh whose bias is known; None where that cannot be."""
    accuracy = part.inputs.asked_accuracy
    if not part.is_alone or accuracy is None:
        return None
    record = part.records[0]
    target = Target(force_n=record.force_measured_n)
    if record.force_measured_n is None:
        target = Target(depth_m=record.depth_measured_m)
    return replay_alone(
        part.inputs.quick_scene(target),
        tolerance=accuracy,
        name=REPLAY_NAME,
        time_limit_s=part.config.replay.time_limit,
    )


def _on_one_path(
    part: Part, fit: ModulusFit | None, path: ReferencePath | None
) -> tuple[Replay, list[TrialFields], list[TrialRecord]]:
    """Press the trials in the order of their forces, and those without one of their depths."""
    inputs = part.settled.inputs
    with_force = [r for r in part.records if r.force_measured_n is not None]
    without = [r for r in part.records if r.force_measured_n is None]
    found = []
    for records, by_depth in ((with_force, False), (without, True)):
        if not records:
            continue
        values = [(r.depth_measured_m if by_depth else r.force_measured_n) or 0.0 for r in records]
        scene = inputs.scene([] if by_depth else values)
        if by_depth:
            say(f"  no force of {len(records)} trials was measured: pressing to the depths")
            inputs = replace(inputs, tolerance=None)
            scene = replace(inputs.scene([]), target=Target(depth_m=max(values)))
        say(f"  meshing {inputs.sensor.title}, preset {setting_of(scene)}{part.label}")
        found.append(
            replay_forces(
                scene,
                values,
                tolerance=inputs.tolerance or inputs.stated_accuracy,
                name=REPLAY_NAME,
                on_progress=lambda _, text: say(f"  {text}"),
                reference=None if by_depth else path,
                stiffer=1.0 if fit is None else fit.factor,
                depths_from_n=part.config.protocol.contact_force if by_depth else None,
                time_limit_s=part.config.replay.time_limit,
            )
        )
    replay = replace(found[0][0], trials=tuple(t for each, _ in found for t in each.trials))
    return replay, [each for _, fields in found for each in fields], with_force + without


def _stated_path(part: Part) -> ReferencePath | None:
    """Press the gel with the stated modulus; None where no force was measured.

    A path that does not depend on the measured forces makes replays of one rig comparable: it goes
    to the largest force that a passed trial may have. Where that force is no bound of the measured
    ones, or time changes the path, it goes to these.
    """
    inputs, forces_n, protocol = part.settled.inputs, part.forces_n, part.config.protocol
    if not forces_n:
        return None
    if any(inputs.tilt_rad):
        return reference_path(inputs.upright.scene(forces_n), forces_n, keep_states=False)
    most_n = max(protocol.force_targets) + protocol.force_tolerance
    is_bound = most_n - 2.0 * protocol.force_tolerance <= max(forces_n) <= most_n
    with time_limit(part.config.replay.time_limit):
        if is_bound and not part.config.is_imported:
            scene = inputs.scene([most_n])
            if not path_depends_on_modulus(plan_effects(scene)):
                return reference_path(scene, [most_n], keep_states=True)
        return reference_path(inputs.scene(forces_n), forces_n, keep_states=True)


# Processor seconds of a press alone at its place, of a path with all its states, and of an image.
_ALONE_S, _PATH_S, _IMAGE_S = 4.5, 40.0, 1.5
_JOBS, _WORTH_PROCESSES = 2, 6
PROBES_NAME = f"{REPLAY_NAME}-probes"
"""Of presses that tell where an indenter is: kept beside the replay, for when it is repeated."""
_BODIES: dict[str, type[Sphere | Cylinder]] = {"Sphere": Sphere, "Cylinder": Cylinder}


@dataclass(frozen=True, slots=True, kw_only=True)
class KeptPart:
    """A finished part on disk."""

    pressed: str  # hash of all that it was pressed with
    seen: str = ""  # hash of what it was rendered with; empty where it was not yet
    # (depth [m], force [N]) of the gel with the stated modulus, in a file of its own
    stated: History = ()
    replay: Replay | None = None  # its trials and model; None in that file


def replay_parts(
    run: RunReading,
    parts: Sequence[Part],
    optics: OpticalCalibration,
    *,
    name: str = REPLAY_NAME,
    afterwards_s: float = 0.0,
) -> list[Replay]:
    """Press and render what is not there yet of parts, and keep each when it is finished.

    Args:
        name: Under which they are kept; those that only probe take the stated modulus.
        afterwards_s: Processor time of what follows [s], for the time that is left.

    Returns:
        The replay of each part; arrays and images of its trials are in the run's folder.
    """
    files = [_PartFiles(run, part, name) for part in _settled(parts)]
    fits = name == REPLAY_NAME and fits_modulus(run.store.config)
    jobs = _JOBS if len(files) >= _WORTH_PROCESSES else 1
    left = Remaining(afterwards_s, jobs=jobs)
    fitted = _fitted(files) if fits else []
    lacking = [own for own in fitted if own.part.forces_n and not own.stated()]
    for own in files:
        left.add(0.0 if own.path.exists() else own.cost_s + _IMAGE_S)
    for own in lacking:
        left.add(own.cost_s)
    say(f"replaying {len(files)} places or indenters; {left}")
    fit = None
    if fits:
        _press_stated(lacking, jobs, left)
        fit = modulus_of([(own.part, own.stated()) for own in fitted])
    found = {own.path: own.finished(fit, optics) for own in files}
    missing = [own for own in files if found[own.path] is None]
    for own in missing:
        left.add(own.cost_s + _IMAGE_S if own.path.exists() else 0.0)
    if len(missing) < len(files):
        say(f"  {len(files) - len(missing)} of {len(files)} places are finished from before")
    if missing:  # the summary of an older replay goes: its files are about to change
        run.store.paths.replay_json(name).unlink(missing_ok=True)
    items = [(own.part, fit, own.stated() if fits else ()) for own in missing]
    work = parallel_map(_press, items, jobs=jobs)
    with doing("pressing to what was measured") as tell:
        for number, (own, (_, pressed)) in enumerate(zip(missing, work, strict=True), start=1):
            found[own.path] = kept = own.keep(fit, pressed, optics)
            left.spend(own.cost_s + _IMAGE_S)
            trial = kept.trials[-1]
            say(
                f"  {number} of {len(missing)}{own.part.label}: {trial.force_simulated_n:.3f} N at "
                f"{trial.depth_simulated_m * 1e3:.3f} mm; {left}"
            )
            tell(str(left))
    return [replay for replay in found.values() if replay is not None]


def _fitted(files: Sequence[_PartFiles]) -> list[_PartFiles]:
    """Return those of the parts that the modulus is fitted to, with force and depth."""
    known = [
        own
        for own in files
        if any(None not in (r.force_measured_n, r.depth_measured_m) for r in own.part.records)
    ]
    return [known[k] for k in some_of_each([own.part for own in known])]


def _press_stated(lacking: Sequence[_PartFiles], jobs: int, left: Remaining) -> None:
    """Press the gel with the stated modulus at each place, and keep its curve."""
    parts = [own.part for own in lacking]
    work = parallel_map(stated_history, parts, jobs=jobs)
    with doing("pressing the gel of the stated modulus") as tell:
        for number, (own, (_, history)) in enumerate(zip(lacking, work, strict=True), start=1):
            own.keep_stated(history)
            left.spend(own.cost_s)
            say(f"  stated modulus, {number} of {len(lacking)}{own.part.label}; {left}")
            tell(str(left))


def _press(item: tuple[Part, ModulusFit | None, History]) -> Pressed:
    with heard(lambda _: None):  # many of them, some in other processes
        return press_to_measured(*item)


def _settled(parts: Sequence[Part]) -> list[Part]:
    """Return parts with the preset that ``auto`` chooses, one for each indenter."""
    found = list(parts)
    for numbers in tools_of(parts):
        together = [k for k in numbers if parts[k].forces_n and not parts[k].is_alone]
        if not together:
            continue
        largest = max(together, key=lambda k: max(parts[k].forces_n))
        settings = parts[largest].settled.inputs
        for k in numbers:
            own = parts[k].inputs
            if own.is_auto and not parts[k].is_alone:
                settled = replace(settings, offset_m=own.offset_m, tilt_rad=own.tilt_rad)
                found[k] = replace(parts[k], inputs=settled)
    return found


class _PartFiles:
    """A part of a run, and what is kept of it."""

    def __init__(self, run: RunReading, part: Part, name: str) -> None:
        self._run, self.part, self._name = run, part, name
        self.cost_s = _ALONE_S if part.is_alone else _PATH_S
        first = min(part.trials)
        self.path = run.store.paths.replay_part(name, first)
        self._gel = self.path.with_name(f"{first:02d}-stated.json")

    def stated(self) -> History:
        """Return the curve of the stated gel; empty where there is none of the same press."""
        kept = _read(self._gel)
        return kept.stated if kept is not None and kept.pressed == self._hash(None) else ()

    def keep_stated(self, history: History) -> None:
        """Keep the curve of the stated gel."""
        kept = KeptPart(pressed=self._hash(None), stated=history)
        write_atomically(self._gel, dumps(kept, indent=None))

    def finished(self, fit: ModulusFit | None, optics: OpticalCalibration) -> Replay | None:
        """Return the finished part; rendered again where its optics were others.

        None where it was pressed with something else, or what was kept cannot be read.
        """
        kept = _read(self.path)
        if kept is None or kept.replay is None or kept.pressed != self._hash(fit):
            return None
        indices = [trial.index for trial in kept.replay.trials]
        images = (self._of_trial(i) / "image.png" for i in indices)
        if kept.seen == _seen_with(optics) and all(image.is_file() for image in images):
            return kept.replay
        with suppress(RecordError, KeyError, ValueError):
            surfaces = {i: surfaces_of(unpack_arrays(self._surfaces(i))) for i in indices}
            return self._render(kept.pressed, kept.replay, surfaces, optics)
        return None

    def keep(self, fit: ModulusFit | None, found: Pressed, optics: OpticalCalibration) -> Replay:
        """Render a pressed part and keep it."""
        replay, by_trial = found
        for index, trial in by_trial.items():
            arrays = arrays_of(trial)
            if arrays:
                write_atomically(self._surfaces(index), pack_arrays(arrays))
        return self._render(self._hash(fit), replay, by_trial, optics)

    def _render(
        self,
        pressed: str,
        replay: Replay,
        by_trial: dict[int, TrialFields],
        optics: OpticalCalibration,
    ) -> Replay:
        attempts = [self._run.read(record) for record in self.part.records]
        replay, files = rendered(attempts, self.part.inputs.sensor, replay, by_trial, optics)
        for index, each in files.items():
            write_fields(self._of_trial(index), each)
        kept = KeptPart(pressed=pressed, seen=_seen_with(optics), replay=replay)
        write_atomically(self.path, dumps(kept, indent=None))
        return replay

    def _hash(self, fit: ModulusFit | None) -> str:
        """Return the hash of all that the part's press depends on."""
        part = self.part
        return content_hash(part.inputs, part.records, part.config.protocol, bool(part.label), fit)

    def _of_trial(self, index: int) -> Path:
        return self._run.store.paths.replay_trial(self._name, index)

    def _surfaces(self, index: int) -> Path:
        return self.path.with_name(f"{index:02d}.npz")


def _seen_with(optics: OpticalCalibration) -> str:
    return content_hash(optics.model.provenance, optics.geometry, optics.shadows, optics.blur_px)


def _read(path: Path) -> KeptPart | None:
    if not path.exists():
        return None
    with suppress(RecordError):
        kept: KeptPart = read_json(KeptPart, path, what="a part of the replay")
        return kept
    return None


def arrays_of(trial: TrialFields) -> dict[str, Any]:
    """Return a trial's surfaces as arrays; none for a body of triangles, which is pressed again."""
    found: dict[str, Any] = {
        "force_n": np.array([state.force_n for state in trial.intermediate]),
        "depth_m": np.array([state.depth_m for state in trial.intermediate]),
    }
    for k, state in enumerate(trial.intermediate):
        found[f"pressure_pa_{k}"] = state.pressure_pa
    for k, surface in enumerate([*(state.surface for state in trial.intermediate), trial.surface]):
        body = surface.indenter
        if not isinstance(body, Sphere | Cylinder):
            return {}
        plain = {each.name: getattr(surface, each.name) for each in fields(surface)}
        plain |= {"kind": type(body).__name__, "mesh_axis_m": surface.mesh_axis_m or ()}
        plain |= {"indenter": list(asdict(body).values())}
        found |= {f"{name}_{k}": np.asarray(value) for name, value in plain.items()}
    return found


def surfaces_of(arrays: dict[str, Any]) -> TrialFields:
    """Return a trial's surfaces from ``arrays_of``; its other fields are on disk already."""
    states = tuple(
        IntermediateState(
            force_n=float(force_n),
            depth_m=float(depth_m),
            surface=_surface(arrays, k),
            pressure_pa=arrays[f"pressure_pa_{k}"],
        )
        for k, (force_n, depth_m) in enumerate(
            zip(arrays["force_n"], arrays["depth_m"], strict=True)
        )
    )
    end = _surface(arrays, len(states))
    return TrialFields(shape={}, at_nodes={}, at_faces={}, surface=end, intermediate=states)


def _surface(arrays: dict[str, Any], k: int) -> SurfaceState:
    plain = {each.name: arrays[f"{each.name}_{k}"] for each in fields(SurfaceState)}
    body = _BODIES[str(arrays[f"kind_{k}"])]
    sizes = zip((each.name for each in fields(body)), plain["indenter"].tolist(), strict=True)
    axis_m = tuple(plain["mesh_axis_m"].tolist())
    own = {"indenter": body(**dict(sizes)), "mesh_axis_m": axis_m or None}
    return SurfaceState(**{**plain, **own, "standoff_m": float(plain["standoff_m"])})
