"""Presses at many places: each part is pressed on its own, and kept when it is finished.

A part is pressed in another process and forgotten there, so that memory does not grow with the
number of parts. Pressed surfaces are kept, too: with other optics only images are made again.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from reports.evidence.fits import ModulusFit
from sim.fields.press_fields import TrialFields
from sim.fields.surface import IntermediateState, SurfaceState
from sim.replay import History
from sim.scene.indenter import Cylinder, Indenter, Sphere, describe
from tacauchy_rig import __version__
from tacauchy_rig.app.replay.mounting import fits_modulus
from tacauchy_rig.app.replay.optics import OpticalCalibration, Say
from tacauchy_rig.app.replay.parts import Part
from tacauchy_rig.app.replay.pressing import (
    Pressed,
    PressTask,
    measured_attempts,
    modulus_of,
    press_to_measured,
    stated_history,
)
from tacauchy_rig.app.replay.rendering import rendered
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.long_task import Remaining, doing
from tacauchy_rig.core.parallel import parallel_map
from tacauchy_rig.core.simulated import REPLAY_NAME, Replay
from tacauchy_rig.core.store.codec import dumps
from tacauchy_rig.core.store.durable import write_atomically
from tacauchy_rig.core.store.journal import read_json
from tacauchy_rig.core.store.replay_files import pack_arrays, unpack_arrays, write_fields

# Processor seconds of a press alone at its place, of a path with all its states, and of an image.
_ALONE_S, _PATH_S, _IMAGE_S = 4.5, 40.0, 1.5
_JOBS, _WORTH_PROCESSES = 2, 6
_ADDRESS = re.compile(r" at 0x[0-9a-f]+")
_BODIES: dict[str, type[Sphere | Cylinder]] = {"Sphere": Sphere, "Cylinder": Cylinder}


@dataclass(frozen=True, slots=True, kw_only=True)
class KeptPart:
    """A finished part on disk.

    Attributes:
        pressed: Hash of all that it was pressed with.
        seen: Hash of what it was rendered with; empty where it was not yet.
        stated: (depth [m], force [N]) of the gel with the stated modulus.
        replay: Its trials and model; None where only the stated gel was pressed so far.
    """

    pressed: str
    seen: str = ""
    stated: History = ()
    replay: Replay | None = None


def replay_parts(
    parts: Sequence[Part],
    optics: OpticalCalibration,
    *,
    afterwards_s: float = 0.0,
    on_progress: Say,
) -> list[Replay]:
    """Press and render what is not there yet of parts, and keep each when it is finished.

    Args:
        afterwards_s: Processor time of what follows [s], for the time that is left.

    Returns:
        The replay of each part; arrays and images of its trials are in the run's folder.

    Raises:
        ConvergenceError: A force cannot be reached.
        RecordError: A recording has no readable no-contact frame, or the disk is full.
    """
    files = [_PartFiles(part) for part in parts]
    tasks = _settled([part.task for part in parts])
    fits = fits_modulus(parts[0].run.store.config)
    jobs = _JOBS if len(parts) >= _WORTH_PROCESSES else 1
    left = Remaining(afterwards_s, jobs=jobs)
    for task, own in zip(tasks, files, strict=True):
        left.add(0.0 if own.is_there else _cost_s(task) + _IMAGE_S)
        left.add(_cost_s(task) if fits and task.forces_n and not own.stated(_hash(task)) else 0.0)
    on_progress(f"replaying {len(parts)} places or indenters; {left}")
    fit = None
    stated: list[History] = [()] * len(parts)
    if fits:
        stated = _stated(tasks, files, left, on_progress)
        fit = modulus_of(list(zip(tasks, stated, strict=True)), on_progress=on_progress)
    done: dict[int, Replay] = {}
    missing = []
    for k, (task, own) in enumerate(zip(tasks, files, strict=True)):
        kept = own.finished(_hash(task, fit), optics)
        if kept is not None:
            done[k] = kept
            continue
        left.add(_cost_s(task) + _IMAGE_S if own.is_there else 0.0)
        missing.append(k)
    if done:
        on_progress(f"  {len(done)} of {len(parts)} places are finished from before")
    if missing:
        files[0].begin()
    items = [(k, tasks[k], fit, stated[k]) for k in missing]
    work = parallel_map(_press, items, jobs=jobs, new_process_each=False)
    with doing("pressing to what was measured") as tell:
        for number, ((k, *_), pressed) in enumerate(work, start=1):
            done[k] = files[k].keep(_hash(tasks[k], fit), pressed, optics, stated[k])
            left.spend(_cost_s(tasks[k]) + _IMAGE_S)
            trial = done[k].trials[-1]
            on_progress(
                f"  {number} of {len(missing)}{tasks[k].label}: {trial.force_simulated_n:.3f} N at "
                f"{trial.depth_simulated_m * 1e3:.3f} mm; {left}"
            )
            tell(str(left))
    return [done[k] for k in range(len(parts))]


def _stated(
    tasks: Sequence[PressTask], files: Sequence[_PartFiles], left: Remaining, say: Say
) -> list[History]:
    """Return what the gel with the stated modulus gives at each place, from disk or pressed."""
    found = {
        k: kept
        for k, (task, own) in enumerate(zip(tasks, files, strict=True))
        if (kept := own.stated(_hash(task)))
    }
    missing = [(k, task) for k, task in enumerate(tasks) if k not in found and task.forces_n]
    jobs = _JOBS if len(tasks) >= _WORTH_PROCESSES else 1
    work = parallel_map(_press_stated, missing, jobs=jobs, new_process_each=False)
    with doing("pressing the gel of the stated modulus") as tell:
        for number, ((k, task), history) in enumerate(work, start=1):
            found[k] = history
            files[k].keep_stated(_hash(task), history)
            left.spend(_cost_s(task))
            say(f"  stated modulus, {number} of {len(missing)}{task.label}; {left}")
            tell(str(left))
    return [found.get(k, ()) for k in range(len(tasks))]


def _press_stated(item: tuple[int, PressTask]) -> History:
    return stated_history(item[1])


def _press(item: tuple[int, PressTask, ModulusFit | None, History]) -> Pressed:
    _, task, fit, stated = item
    return press_to_measured(task, fit, stated=stated)


def _settled(tasks: Sequence[PressTask]) -> list[PressTask]:
    """Return tasks with the preset that ``auto`` chooses, one for each indenter.

    What is pressed alone at its place chooses for itself, without a press.
    """
    largest: dict[str, PressTask] = {}
    for task in tasks:
        tool = describe(task.inputs.indenter)
        known = largest.get(tool)
        if task.is_alone or not task.forces_n:
            continue
        if known is None or max(task.forces_n) > max(known.forces_n):
            largest[tool] = task
    chosen = {tool: task.settled.inputs for tool, task in largest.items()}
    found = []
    for task in tasks:
        own, settings = task.inputs, chosen.get(describe(task.inputs.indenter))
        if settings is not None and own.is_auto and not task.is_alone:
            own = replace(settings, offset_m=own.offset_m, tilt_rad=own.tilt_rad)
        found.append(replace(task, inputs=own))
    return found


def _cost_s(task: PressTask) -> float:
    return _ALONE_S if task.is_alone else _PATH_S


def _hash(task: PressTask, fit: ModulusFit | None = None) -> str:
    """Return the hash of all that a part's press depends on."""
    return _hash_of(task.inputs, task.records, task.config.protocol, task.quick, fit)


def _seen_with(optics: OpticalCalibration) -> str:
    return _hash_of(optics.model.provenance, optics.geometry, optics.shadows, optics.blur_px)


def _hash_of(*told: object) -> str:
    return sha256(_written((__version__, *told)).encode()).hexdigest()


def _written(told: object) -> str:
    """Return values as text that is the same in every process."""
    with np.printoptions(threshold=10_000_000):
        return _ADDRESS.sub("", repr(told))


class _PartFiles:
    """What is kept of a part of a run."""

    def __init__(self, part: Part) -> None:
        self._part, self._store = part, part.run.store
        paths = self._store.paths
        first = min(part.run.records)
        self._path = paths.replay_part(REPLAY_NAME, first)
        self._gel = self._path.with_name(f"{first:02d}-stated.json")

    @property
    def is_there(self) -> bool:
        """Whether the part was finished once, with whatever it was pressed."""
        return self._path.exists()

    def begin(self) -> None:
        """Take the summary of an older replay away: its files are about to change."""
        self._store.paths.replay_json(REPLAY_NAME).unlink(missing_ok=True)

    def stated(self, pressed: str) -> History:
        """Return the curve of the stated gel; empty where there is none of the same press."""
        kept = _read(self._gel)
        return kept.stated if kept is not None and kept.pressed == pressed else ()

    def keep_stated(self, pressed: str, history: History) -> None:
        """Keep the curve of the stated gel."""
        self._write(self._gel, KeptPart(pressed=pressed, stated=history))

    def finished(self, pressed: str, optics: OpticalCalibration) -> Replay | None:
        """Return the finished part; rendered again where its optics were others.

        None where it was pressed with something else, or what was kept cannot be read.
        """
        kept = _read(self._path)
        if kept is None or kept.replay is None or kept.pressed != pressed:
            return None
        if kept.seen == _seen_with(optics) and self._has_images(kept.replay):
            return kept.replay
        with suppress(RecordError, KeyError, ValueError):
            fields = {t.index: self._read_surfaces(t.index) for t in kept.replay.trials}
            return self._render(kept, fields, optics)
        return None

    def keep(
        self, pressed: str, found: Pressed, optics: OpticalCalibration, stated: History
    ) -> Replay:
        """Render a pressed part and keep it."""
        replay, fields = found
        for index, trial in fields.items():
            arrays = _arrays_of(trial)
            if arrays:
                write_atomically(self._surfaces(index), pack_arrays(arrays))
        return self._render(KeptPart(pressed=pressed, stated=stated, replay=replay), fields, optics)

    def _render(
        self, kept: KeptPart, fields: dict[int, TrialFields], optics: OpticalCalibration
    ) -> Replay:
        if kept.replay is None:
            raise ValueError("nothing was pressed")
        attempts = measured_attempts(self._part.run)
        replay, files = rendered(attempts, self._part.inputs.sensor, kept.replay, fields, optics)
        for index, each in files.items():
            write_fields(self._store.paths.replay_trial(REPLAY_NAME, index), each)
        self._write(self._path, replace(kept, seen=_seen_with(optics), replay=replay))
        return replay

    def _write(self, path: Path, kept: KeptPart) -> None:
        write_atomically(path, dumps(kept, indent=None))

    def _has_images(self, replay: Replay) -> bool:
        folders = (self._store.paths.replay_trial(REPLAY_NAME, t.index) for t in replay.trials)
        return all((folder / "image.png").is_file() for folder in folders)

    def _surfaces(self, index: int) -> Path:
        return self._path.with_name(f"{index:02d}.npz")

    def _read_surfaces(self, index: int) -> TrialFields:
        """Return a trial's surfaces; its other fields are on disk already."""
        arrays = unpack_arrays(self._surfaces(index))
        count = int(arrays["count"])
        states = tuple(
            IntermediateState(
                force_n=float(arrays[f"force_n_{k}"]),
                depth_m=float(arrays[f"depth_m_{k}"]),
                surface=_surface(arrays, k),
                pressure_pa=arrays[f"pressure_pa_{k}"],
            )
            for k in range(count)
        )
        end = _surface(arrays, count)
        return TrialFields(shape={}, at_nodes={}, at_faces={}, surface=end, intermediate=states)


def _read(path: Path) -> KeptPart | None:
    if not path.exists():
        return None
    with suppress(RecordError):
        kept: KeptPart = read_json(KeptPart, path, what="a part of the replay")
        return kept
    return None


def _arrays_of(fields: TrialFields) -> dict[str, Any]:
    """Return a trial's surfaces as arrays; none for a body of triangles, which is pressed again."""
    found: dict[str, Any] = {"count": np.array(len(fields.intermediate))}
    for k, surface in enumerate([*(s.surface for s in fields.intermediate), fields.surface]):
        body = _body_of(surface.indenter)
        if body is None:
            return {}
        axis = () if surface.mesh_axis_m is None else surface.mesh_axis_m
        found |= {
            f"rest_{k}": surface.positions_rest,
            f"now_{k}": surface.positions,
            f"faces_{k}": surface.faces,
            f"tip_{k}": surface.indenter_position,
            f"rotation_{k}": surface.indenter_rotation,
            f"standoff_{k}": np.array(surface.standoff_m),
            f"axis_{k}": np.array(axis),
            f"kind_{k}": np.array(type(surface.indenter).__name__),
            f"body_{k}": np.array(list(body.values())),
            f"keys_{k}": np.array(list(body)),
        }
    for k, state in enumerate(fields.intermediate):
        found[f"force_n_{k}"] = np.array(state.force_n)
        found[f"depth_m_{k}"] = np.array(state.depth_m)
        found[f"pressure_pa_{k}"] = state.pressure_pa
    return found


def _body_of(indenter: Indenter) -> dict[str, float] | None:
    return asdict(indenter) if isinstance(indenter, Sphere | Cylinder) else None


def _surface(arrays: dict[str, Any], k: int) -> SurfaceState:
    body = dict(zip(arrays[f"keys_{k}"].tolist(), arrays[f"body_{k}"].tolist(), strict=True))
    axis = arrays[f"axis_{k}"].tolist()
    return SurfaceState(
        positions_rest=arrays[f"rest_{k}"],
        positions=arrays[f"now_{k}"],
        faces=arrays[f"faces_{k}"],
        indenter=_BODIES[str(arrays[f"kind_{k}"])](**body),
        indenter_position=arrays[f"tip_{k}"],
        indenter_rotation=arrays[f"rotation_{k}"],
        standoff_m=float(arrays[f"standoff_{k}"]),
        mesh_axis_m=(axis[0], axis[1]) if axis else None,
    )


def tools_of(parts: Sequence[Part]) -> Iterator[list[int]]:
    """Yield the numbers of the parts of each indenter."""
    groups: dict[str, list[int]] = {}
    for k, part in enumerate(parts):
        groups.setdefault(part.tool, []).append(k)
    yield from groups.values()
