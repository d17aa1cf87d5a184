"""A press as every format takes it, and the ``import.toml`` that lets ``import`` take it back."""

import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from sim.scene.indenter import describe
from tacauchy_rig.app.importing.importer import MESH, PATH_FIELDS, RIG_FIELDS, RIG_TABLES, SPEC_NAME
from tacauchy_rig.app.importing.press_detection import Samples, Window
from tacauchy_rig.app.importing.text_tables import as_toml
from tacauchy_rig.app.replay import simulator_inputs
from tacauchy_rig.core.arrays import AnyArray, FloatArray, ImageArray, IndexArray, Int64Array
from tacauchy_rig.core.errors import RecordError, command_line
from tacauchy_rig.core.image_codec import decode_rgb
from tacauchy_rig.core.registry import Kind, unknown
from tacauchy_rig.core.run import ImageFrame, TrialRecord
from tacauchy_rig.core.simulated import REPLAY_NAME
from tacauchy_rig.core.store.atomic_write import write_atomically
from tacauchy_rig.core.store.run_store import RunStore
from tacauchy_rig.core.time_limit_and_progress import doing
from tacauchy_rig.core.versions import library

_NUMBERS = (
    *("force_target_n", "force_measured_n", "force_deviation_n", "force_drift_n"),
    *("contact_z_m", "depth_measured_m", "arm_force_n"),
)
_KEPT = ("displacement_m", "contact_pressure_pa", "contact_shear_pa", "node_rest_m", "faces")
"""Of a replay's fields what others ask for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Episode:
    """One press."""

    name: str
    force: Samples  # wrenches in the force sensor's frame, raw [N, N m]
    # Of the tip in the robot's base frame [m, rad]; None where nobody recorded it
    pose: Samples | None
    velocity: FloatArray  # of the tip at the pose's stamps [m/s, rad/s], shape [n, 6]
    # What the arm itself felt then [N, N m], shape [n, 6]; NaN where it did not say
    arm_wrench: FloatArray
    frames: Callable[[], Iterator[ImageFrame]]  # yields all images, in order
    stamps_ns: Int64Array  # of the images, shape [n]
    # First and last stamp [ns] of ``tare``, ``reference`` (no contact) and ``dwell``
    windows: Mapping[str, Window]
    # Numbers with their unit in the name, and words; None is not known
    outputs: Mapping[str, float | str | None]
    # Returns the simulated arrays, units in the names; none of what was not replayed
    fields: Callable[[], Mapping[str, AnyArray]]

    @property
    def tared(self) -> Samples:
        """The force without its zero before the press; raw where that is not known."""
        if "tare" not in self.windows:
            return self.force
        zero = self.force.within(self.windows["tare"]).value.mean(axis=0)
        return Samples(stamp_ns=self.force.stamp_ns, value=self.force.value - zero)


def episodes_of(store: RunStore) -> Iterator[Episode]:
    """Yield the attempts of a run that count, one a trial.

    Raises:
        RecordError: None of them has a recording, or one is damaged.
    """
    found = [store.counting(index) for index in store.trial_indices()]
    records = [r for r in found if r and store.paths.recording(r.index, r.attempt).exists()]
    if not records:
        raise RecordError(
            f"{store.paths.root}: holds no recording to export",
            remedy=f"`{command_line('resume', store.paths.root)}` presses what is missing",
        )
    for record in records:
        episode = _episode(store, record)
        with doing(f"exporting {episode.name}"):
            yield episode


def _episode(store: RunStore, record: TrialRecord) -> Episode:
    recording = store.recording(record.index, record.attempt)
    force, arm = recording.force, recording.arm
    numbers = {name: getattr(record, name) for name in _NUMBERS}
    words = {"outcome": record.outcome.value, "run": store.paths.root.name}
    words["sensor"] = store.config.sensor.name
    return Episode(
        name=f"trial-{record.index:02d}",
        force=Samples(stamp_ns=force.stamp_ns, value=force.wrench),
        pose=Samples(stamp_ns=arm.stamp_ns, value=arm.pose) if len(arm.stamp_ns) else None,
        velocity=arm.velocity,
        arm_wrench=arm.tcp_force,
        frames=recording.frames,
        stamps_ns=recording.frame_stamps()[0],
        windows=record.windows,
        outputs={**{k: v if v == v else None for k, v in numbers.items()}, **words},
        fields=lambda: _fields(store, record.index),
    )


def _fields(store: RunStore, trial: int) -> dict[str, AnyArray]:
    """Return what the replay of a trial gave; nothing where it was not replayed."""
    if not store.paths.replay_trial(REPLAY_NAME, trial).is_dir():
        return {}
    found = store.load_replay_fields(REPLAY_NAME, trial)
    kept = {name: found.fields[name] for name in _KEPT if name in found.fields}
    seen = {f"height_{name}": each for name, each in found.height.items() if name != "contact"}
    return kept | seen | ({} if found.image is None else {"image_simulated": found.image})


@dataclass(frozen=True, slots=True, kw_only=True)
class Rows:
    """An episode at an even rate: each row has what was newest at its time."""

    time_s: FloatArray  # since the first row, shape [n]
    frame: IndexArray  # number of the image, shape [n]
    wrench: FloatArray  # tared, shape [n, 6]
    window: FloatArray  # the samples of force up to each row, the newest last, shape [n, k, 6]
    state: FloatArray | None  # pose of the tip, shape [n, 6]; None where nobody recorded it


def even_rows(episodes: list[Episode]) -> tuple[int, list[Rows]]:
    """Return the camera's rate in whole images a second, and the episodes at that rate.

    Raises:
        RecordError: No press has two images, or one has no time with all its streams.
    """
    images = np.concatenate([np.diff(each.stamps_ns) for each in episodes])
    forces = np.concatenate([np.diff(each.force.stamp_ns) for each in episodes])
    if not (len(images) and len(forces)):
        raise RecordError(
            "the presses have fewer than two images or samples of force, so there is no rate",
            remedy="export them --to csv",
        )
    rate = max(1, round(1e9 / float(np.median(images))))
    count = max(1, round(1e9 / rate / float(np.median(forces))))
    return rate, [_rows(each, rate, count) for each in episodes]


def _rows(episode: Episode, rate: int, count: int) -> Rows:
    """Return an episode at a rate [Hz], each row with its newest ``count`` samples of force."""
    force, pose = episode.tared, episode.pose
    streams = [episode.stamps_ns, force.stamp_ns[count - 1 :], *([pose.stamp_ns] if pose else [])]
    common = all(len(each) for each in streams)
    starts, ends = ([int(each[k]) for each in streams] if common else [1] for k in (0, -1))
    number = (min(ends) - max(starts)) * rate // 1_000_000_000 + 1
    if not common or number < 1:
        raise RecordError(
            f"{episode.name}: its images, force and pose have no time in common",
            remedy="leave the trial out of the run, or export it --to rosbag2",
        )
    time_s = np.arange(number) / rate
    stamps = max(starts) + np.rint(1e9 * time_s).astype(np.int64)
    newest = _newest(force.stamp_ns, stamps)
    state = None if pose is None else pose.value[_newest(pose.stamp_ns, stamps)]
    return Rows(
        time_s=time_s,
        frame=_newest(episode.stamps_ns, stamps),
        wrench=force.value[newest],
        window=force.value[newest[:, None] + np.arange(1 - count, 1)],
        state=state,
    )


def _newest(stamps_ns: Int64Array, at_ns: Int64Array) -> IndexArray:
    """Return which of ascending stamps was the newest at some times."""
    return np.searchsorted(stamps_ns, at_ns, side="right") - 1


def images_of(episode: Episode, rows: Rows) -> Iterator[ImageArray]:
    """Yield the image of each row, RGB. RecordError: One is damaged."""
    repeats = np.bincount(rows.frame, minlength=len(episode.stamps_ns)).tolist()
    for number, frame in enumerate(episode.frames()):
        image = decode_rgb(frame.jpeg) if repeats[number] else None
        if image is None and repeats[number]:
            raise RecordError(
                f"{episode.name}: image {number + 1} is damaged",
                remedy="`tacauchy-rig recover RUN` repairs what it can",
            )
        yield from [image] * repeats[number] if image is not None else ()


needed = partial(library, extra="export")
"""Imports a library that a format needs."""


_EXACT_SHARE = 1e-9


def write_spec(store: RunStore, out: Path, kind: str, data: Mapping[str, object]) -> None:
    """Write what a source of a run's presses says of itself; files that it names come with it."""
    written = store.description["written"]
    rig = {k: v for k, v in written.items() if k in RIG_FIELDS or k.partition(".")[0] in RIG_TABLES}
    rig["replay.indenter"] = indenter_of(store)
    for field in (*PATH_FIELDS, "replay.indenter"):
        rig |= {field: _within(out, field, str(rig[field]))} if rig.get(field) else {}
    head = {"kind": kind, "name": store.config.run.name, "simulated": store.simulated}
    tables = {"data": data, "rig": rig}
    lines = {f"{table}.{k}": v for table, values in tables.items() for k, v in values.items()}
    write_atomically(out / SPEC_NAME, as_toml({**head, **lines}).encode())


def _within(out: Path, field: str, value: str) -> str:
    """Return a value; the file that it names is copied into the export."""
    if field == "replay.indenter" and not value.startswith(MESH):
        return value
    if field == "sensor.name" and not unknown(Kind.SENSOR, value):
        return value
    name, *further = value.removeprefix(MESH).split(",")
    shutil.copy2(name, out / Path(name).name)
    mesh = MESH if value.startswith(MESH) else ""
    return ",".join([f"{mesh}{Path(name).name}", *further])


def indenter_of(store: RunStore) -> str:
    """Return a run's indenter as ``press --indenter`` has it."""
    return store.config.replay.indenter or describe(simulator_inputs.indenter_of(store.config))


def pad_centre(store: RunStore) -> tuple[float, float] | None:
    """Return where the tip is above the pad's centre in the robot's frame [m]; None: not known."""
    if not store.config.is_imported:
        x, y, _ = store.config.sensor.surface
        return x, y
    centres = []
    for index, trial in store.imported_trials.items():
        record = store.counting(index)
        if record is None or trial.place_m is None or "dwell" not in record.windows:
            return None
        arm = store.recording(index, record.attempt).arm
        held = Samples(stamp_ns=arm.stamp_ns, value=arm.pose).within(record.windows["dwell"])
        if not len(held.value):
            return None
        centres.append(held.value[:, :2].mean(axis=0) - trial.place_m)
    x, y = np.mean(centres, axis=0).tolist()
    return None if np.ptp(centres, axis=0).max() > _EXACT_SHARE else (x, y)
