"""One run's folder: the only way in and out for results, replays and what the run is."""

import io
import logging
import time
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from tacauchy_rig.core.config.load import LoadedConfig, restore_config
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.errors import RecordError, command_line, naming
from tacauchy_rig.core.image_codec import decode_rgb, encode_png
from tacauchy_rig.core.known_weight import ForceCheck
from tacauchy_rig.core.run import (
    CalibratedOptics,
    ExpectedPress,
    Imported,
    ImportedTrial,
    TrialRecord,
)
from tacauchy_rig.core.simulated import Replay
from tacauchy_rig.core.store.atomic_write import bytes_sha256, run_lock, write_atomically, writing
from tacauchy_rig.core.store.journal import HashedFile, Journal, StoreEvent, log_hashes, previous_of
from tacauchy_rig.core.store.json_codec import dumps, from_json, loads, read_json, to_json
from tacauchy_rig.core.store.recording.mcap_reader import Recording
from tacauchy_rig.core.store.run_files import RunPaths, file_sha256, read_bytes, run_folder

_MAX_UNPACKED_BYTES = 1 << 30
_REMEDY = "replay the run again: `tacauchy-rig replay RUN`"


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayFields:
    """What the simulator leaves of one trial."""

    # Named arrays of the mechanics (SI), into ``fields.npz``
    fields: dict[str, NDArray[Any]] = field(default_factory=dict)
    # Named arrays of the deformed surface seen by the camera (SI), into ``height.npz``
    height: dict[str, NDArray[Any]] = field(default_factory=dict)
    # Rendered tactile image, RGB uint8, shape [height, width, 3], into ``image.png``
    image: NDArray[np.uint8] | None = None
    # The deformed surface for ParaView, the whole file, into ``surface.vtu``
    surface_vtu: bytes | None = None
    # Small images and maps on the way to the force, into ``passed.npz``; empty where the replay is
    # from before they were kept
    passed: dict[str, NDArray[Any]] = field(default_factory=dict)


_ARRAYS = ("fields", "height", "passed")


def write_fields(folder: Path, fields: ReplayFields) -> None:
    """Write one trial's arrays and image, each file whole or not at all."""
    for name in _ARRAYS:
        if arrays := getattr(fields, name):
            write_atomically(folder / f"{name}.npz", pack_arrays(arrays))
    if fields.image is not None:
        write_atomically(folder / "image.png", encode_png(fields.image))
    if fields.surface_vtu is not None:
        write_atomically(folder / "surface.vtu", fields.surface_vtu)


def read_fields(folder: Path) -> ReplayFields:
    """Read what there is of one trial."""
    if not folder.is_dir():
        raise RecordError(f"{folder}: this trial was not replayed", remedy=_REMEDY)
    path, surface = folder / "image.png", folder / "surface.vtu"
    image = decode_rgb(read_bytes(path, what="the image")) if path.exists() else None
    if image is None and path.exists():
        raise RecordError(f"{path}: not a readable PNG", remedy=_REMEDY)
    return ReplayFields(
        image=image,
        surface_vtu=read_bytes(surface, what="the surface") if surface.exists() else None,
        **{name: unpack_arrays(folder / f"{name}.npz") for name in _ARRAYS},
    )


def pack_arrays(arrays: dict[str, NDArray[Any]]) -> bytes:
    """Return named arrays as the bytes of an ``.npz`` file."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def pack_array(array: NDArray[Any]) -> bytes:
    """Return an array as the bytes of an ``.npy`` file."""
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=False)
    return buffer.getvalue()


def unpack_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Read named arrays; none where there is no file."""
    if not path.exists():
        return {}
    content = io.BytesIO(read_bytes(path, what="the fields"))
    try:
        with zipfile.ZipFile(content) as archive:
            size = sum(each.file_size for each in archive.infolist())
        if size > _MAX_UNPACKED_BYTES:
            raise ValueError(f"its arrays take {size / 1e6:.0f} MB")
        with np.load(content, allow_pickle=False) as data:
            return dict(data)
    except Exception as error:  # NumPy, zipfile and zlib raise a dozen kinds of a foreign file
        raise RecordError(f"{path}: damaged: {error}", remedy=_REMEDY) from error


logger = logging.getLogger(__name__)


FORMAT = 1
_DESCRIPTION = "the run's description"
_DEEPEST_M = 0.1
"""Of a press: no gel is a tenth as thick."""
T = TypeVar("T")


class RunStore:
    """Reads and writes one run folder.

    Methods that read raise RecordError where a file is missing or damaged, which names file and
    field; those that write, where the disk is full or gone.

    Attributes:
        paths: Where everything lies.
        config: The run's configuration, checked.
        config_hash: Hash of the configuration as it was when the run was created.
        simulated: Any device of the run was not real.
        expected: What the presses of the run should give; made before the first.
        force_check: The newest check of the cell; the journal holds those before it.
        imported: What others recorded of it, and how; only of an imported run.
        optics: What its presses gave when optics were calibrated from them.
        truth: What the emulated world really is, as its emulators wrote it; never of a real rig.
    """

    def __init__(self, root: Path, description: dict[str, Any]) -> None:
        self.paths = RunPaths(root)
        self.description = description
        with naming(f"{self.paths.run_json}: written"):
            self.config: RigConfig = restore_config(description["written"])
        self.config_hash: str = description["config_hash"]
        self.simulated: bool = description["simulated"]
        self._recordings: dict[Any, Recording] = {}
        paths = self.paths

        def hashed(path: Path, kind: type[T], what: str) -> HashedFile[T]:
            return HashedFile(path, kind, paths.journal, what)

        self._run_json = hashed(paths.run_json, dict[str, Any], _DESCRIPTION)
        self.expected = hashed(paths.expected, ExpectedPress, "the expectation")
        self.force_check = hashed(paths.force_check, ForceCheck, "the check of the cell")
        self.imported = hashed(paths.imported, Imported, "the word on what was imported")
        self.optics = hashed(paths.optics_json, CalibratedOptics, "the calibration of its optics")
        self.truth = hashed(paths.truth, dict[str, Any], "the emulated world's truth")

    @classmethod
    def create(
        cls,
        parent: Path,
        loaded: LoadedConfig,
        *,
        config_text: str,
        simulated: bool,
        versions: dict[str, str],
    ) -> Self:
        """Make a new run folder ``YYYYmmdd-HHMMSS-NAME`` in ``parent``.

        Raises:
            RecordError: ``parent`` cannot be written, or its disk is full.
        """
        created = datetime.now(UTC)
        root = _new_folder(parent, f"{created:%Y%m%d-%H%M%S}-{loaded.config.run.name}")
        description = {
            "format": FORMAT,
            "run": root.name,
            "name": loaded.config.run.name,
            "created": created.isoformat(timespec="seconds"),
            "simulated": simulated,
            "seed": loaded.config.emulation.seed,
            "config_hash": loaded.config_hash,
            "config": loaded.config.model_dump(mode="json"),
            "written": loaded.written,
            "sources": loaded.sources,
            "rig_toml_sha256": bytes_sha256(config_text.encode()),
            "versions": versions,
            "devices": {},
            "clock": {"monotonic_ns": time.monotonic_ns(), "epoch_ns": time.time_ns()},
        }
        paths = RunPaths(root)
        write_atomically(paths.rig_toml, config_text.encode())
        write_atomically(paths.run_json, dumps(description))
        return cls(root, loads(dumps(description), source=str(paths.run_json)))

    @classmethod
    def open(cls, root: Path) -> Self:
        """Open a run folder.

        Raises:
            RecordError: ``root`` is no run folder, or its description is damaged.
            ConfigError: Its configuration is no longer accepted.
        """
        path = run_folder(root).run_json
        try:
            return cls(root, _read_description(path))
        except RecordError as error:
            if not previous_of(path).exists():
                raise
            logger.warning("%s; taking its content before", error.message)
        return cls(root, _read_description(previous_of(path)))

    def mend_files(self) -> None:
        """Set aside what cannot be read of the files of the run as a whole."""
        self._run_json.mend()
        for file in (self.expected, self.force_check, self.imported, self.optics, self.truth):
            file.mend()

    def set_devices(self, devices: Mapping[str, Any]) -> None:
        """Record who answered: name of the device to its DeviceIdentity.

        A device that turns out to be a program on this computer makes the run a simulated one,
        whatever driver the configuration names.
        """
        answered = to_json(devices)
        self.simulated = self.simulated or any(d.get("simulated") for d in answered.values())
        self.description |= {"devices": answered, "simulated": self.simulated}
        self._run_json.save(self.description)

    @cached_property
    def imported_trials(self) -> dict[int, ImportedTrial]:
        """What was imported of each trial, by its index; nothing of a run of ours.

        RecordError where it is an imported run, and the file that says so is missing or damaged.
        """
        if not self.config.is_imported:
            return {}
        found = self.imported.load()
        if found is None:
            raise RecordError(
                f"{self.paths.imported}: missing, and this run was imported",
                remedy="import it again from its source: `tacauchy-rig import FOLDER`",
            )
        return {trial.index: trial for trial in found.trials}

    def trial_indices(self) -> list[int]:
        """Return the trials that a run has or is to have, ascending."""
        count = len(self.config.protocol.force_targets)
        return sorted(self.imported_trials) or list(range(1, count + 1))

    def next_attempt(self, trial: int) -> int:
        """Return the number that the next attempt at a trial has to take."""
        return max(self.paths.attempt_indices(trial), default=0) + 1

    def save_result(self, record: TrialRecord) -> None:
        """Write ``result.json`` and seal it; one that is there already is only sealed."""
        previous = self.load_result(record.index, record.attempt)
        path = self.paths.result(record.index, record.attempt)
        if previous is None:
            write_atomically(path, dumps(record))
        elif _without_hash(previous) != _without_hash(record):
            raise RecordError(
                f"{path}: attempt {record.attempt} at trial {record.index} has ended already: "
                f"{previous.outcome}",
                remedy="results are never overwritten: start a new attempt",
            )
        self.log_result_hashes(record.index, record.attempt)

    def log_result_hashes(self, trial: int, attempt: int) -> None:
        """Write the hashes of a result and its recording into the journal, once."""
        known, path = Journal.read(self.paths.journal), self.paths.result(trial, attempt)
        if known.store_events(StoreEvent.SEALED, trial=trial, attempt=attempt):
            return
        record = read_json(TrialRecord, path, what="the result")
        log_hashes(
            self.paths.journal,
            StoreEvent.SEALED,
            trial=trial,
            attempt=attempt,
            result_sha256=file_sha256(path, what="the result"),
            recording_sha256=record.recording_sha256,
        )

    def recording(self, trial: int, attempt: int) -> Recording:
        """Return an attempt's recording, opened once as long as its file is the same."""
        return self.opened(self.paths.recording(trial, attempt))

    def opened(self, path: Path) -> Recording:
        """Return a recording by its path, as ``recording`` does."""
        state = path.stat() if path.exists() else None
        key = (path, state and (state.st_mtime_ns, state.st_size))
        if key not in self._recordings:
            self._recordings[key] = Recording.open(path)
        return self._recordings[key]

    def load_result(self, trial: int, attempt: int) -> TrialRecord | None:
        """Return an attempt's result, or None if it has none (it was cut off)."""
        path = self.paths.result(trial, attempt)
        if not path.exists():
            return None
        record = read_json(TrialRecord, path, what="the result")
        if (record.index, record.attempt) != (trial, attempt):
            raise RecordError(
                f"{path}: index, attempt: {record.index}, {record.attempt} are not those of the "
                f"folder, {trial}, {attempt}",
                remedy="the file was moved or edited: take it from a copy of the run",
            )
        depths_m, forces_n = record.press_depth_m, record.press_force_n
        deepest_m = max(map(abs, depths_m), default=0.0)
        if len(depths_m) != len(forces_n) or deepest_m > _DEEPEST_M:
            raise RecordError(
                f"{path}: press_depth_m: {len(depths_m)} depths, to {1e3 * deepest_m:.4g} mm, of "
                f"{len(forces_n)} forces; each force has one, of {1e3 * _DEEPEST_M:g} mm at most",
                remedy="the file was edited: take it from a copy of the run",
            )
        return record

    def readable_result(self, trial: int, attempt: int) -> TrialRecord | None:
        """Return a result, or None where there is none or it is damaged, as if it was cut off.

        The check of the run names it (``tacauchy_rig.core.store.check``).
        """
        try:
            return self.load_result(trial, attempt)
        except RecordError as error:
            logger.info("%s; passed over", error.message)
            return None

    def latest(self, trial: int) -> TrialRecord | None:
        """Return the result of the latest attempt that has one."""
        return next(self._results(trial), None)

    def accepted(self, trial: int) -> TrialRecord | None:
        """Return the result of the latest attempt that passed."""
        return next((result for result in self._results(trial) if result.passed), None)

    def _results(self, trial: int) -> Iterator[TrialRecord]:
        """Yield the readable results of a trial's attempts, the latest first."""
        numbers = reversed(self.paths.attempt_indices(trial))
        found = (self.readable_result(trial, number) for number in numbers)
        return (result for result in found if result is not None)

    def counting(self, trial: int) -> TrialRecord | None:
        """Return the result that counts: the latest that passed, or else the latest that ended."""
        return self.accepted(trial) or self.latest(trial)

    def save_replay(self, replay: Replay, fields: Mapping[int, ReplayFields]) -> None:
        """Write a replay, the arrays and images of its trials, and the hashes of all of it.

        Args:
            fields: Of the trials whose files are not there yet.
        """
        folder = self.paths.replays / replay.name
        for trial, trial_fields in fields.items():
            write_fields(self.paths.replay_trial(replay.name, trial), trial_fields)
        files = {
            str(path.relative_to(folder)): file_sha256(path, what="a file of the replay")
            for trial in sorted({each.index for each in replay.trials} | set(fields))
            for path in sorted(self.paths.replay_trial(replay.name, trial).glob("*"))
        }
        sources = {"config": self.config_hash, **self._recorded_hashes(replay)}
        if (sensor := Path(self.config.sensor.name)).suffix == ".toml":  # outside the run
            sources["sensor"] = file_sha256(sensor, what="the sensor file")
        content = dumps(replace(replay, made_from=sources, files=files))
        write_atomically(self.paths.replay_json(replay.name), content)
        log_hashes(
            self.paths.journal,
            StoreEvent.REPLAYED,
            name=replay.name,
            replay_sha256=bytes_sha256(content),
        )

    def _recorded_hashes(self, replay: Replay) -> dict[str, str]:
        """Return the SHA-256 of results and recordings of the trials, by file within the run."""
        records = [self.counting(trial.index) for trial in replay.trials]
        keys = [(record.index, record.attempt) for record in records if record is not None]
        paths = [p for key in keys for p in (self.paths.result(*key), self.paths.recording(*key))]
        return {
            str(path.relative_to(self.paths.root)): file_sha256(path, what="what was recorded")
            for path in paths
            if path.exists()
        }

    def load_replay(self, name: str) -> Replay:
        """Read a replay."""
        path = self.paths.replay_json(name)
        if not path.exists():
            names = ", ".join(self.replays()) or "none"
            raise RecordError(
                f"{self.paths.root}: has no finished replay {name!r}; it has: {names}",
                remedy=f"`{command_line('replay', self.paths.root)}` makes one",
            )
        return read_json(Replay, path, what="the replay")

    def replays(self) -> list[str]:
        """Return the names of finished replays."""
        return sorted(path.parent.name for path in self.paths.replays.glob("*/replay.json"))

    def load_replay_fields(self, name: str, trial: int) -> ReplayFields:
        """Read one replayed trial's arrays and image; RecordError if they are damaged."""
        return read_fields(self.paths.replay_trial(name, trial))

    def lock(self) -> AbstractContextManager[None]:
        """Hold the run against other programs in the returned context, as ``run_lock`` does."""
        return run_lock(self.paths.lock)


def _without_hash(record: TrialRecord) -> bytes:
    """Return what two processes record alike about one attempt."""
    return dumps(replace(record, recording_sha256=None))


def _new_folder(parent: Path, name: str) -> Path:
    number = 1
    while True:
        root = parent / (name if number == 1 else f"{name}-{number}")
        with writing(root):
            try:
                root.mkdir(parents=True)
                return root
            except FileExistsError:
                number += 1


@dataclass(frozen=True, slots=True, kw_only=True)
class _Needed:
    """What is read of a description; the rest of it is for people."""

    format: int
    written: dict[str, Any]
    config_hash: str
    simulated: bool
    devices: dict[str, dict[str, Any]]
    created: str


def _read_description(path: Path) -> dict[str, Any]:
    try:
        description = read_json(dict[str, Any], path, what=_DESCRIPTION)
    except RecordError as error:
        if (path.parent / "trials").exists():
            raise
        raise RecordError(
            f"{error.message}; no attempt was recorded in it",
            remedy="it was cut off while it was made: remove the folder and record a new run",
        ) from error
    needed = {name: description[name] for name in _Needed.__annotations__ if name in description}
    if from_json(_Needed, needed, source=str(path)).format != FORMAT:
        raise RecordError(
            f"{path}: written in format {needed['format']}; this program reads {FORMAT}",
            remedy="use the version of the program named under versions in that file",
        )
    return description
