"""A run as CSV files and images."""

import logging
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tacauchy_rig.app.exporting.episode_and_import_toml import indenter_of, pad_centre, write_spec
from tacauchy_rig.app.importing.table_rows import POSE, WRENCH
from tacauchy_rig.app.importing.text_tables import as_csv
from tacauchy_rig.core.arrays import AnyArray, Int64Array
from tacauchy_rig.core.errors import RecordError, command_line
from tacauchy_rig.core.run import TrialRecord
from tacauchy_rig.core.store.atomic_write import write_atomically
from tacauchy_rig.core.store.recording import mcap_writer
from tacauchy_rig.core.store.recording.mcap_reader import Recording
from tacauchy_rig.core.store.run_store import RunStore
from tacauchy_rig.core.store.trusted_force import force_series
from tacauchy_rig.core.time_limit_and_progress import doing

logger = logging.getLogger(__name__)

_TARED_FIELDS = tuple(f"{name}_tared" for name in mcap_writer.WRENCH_FIELDS)
_FRAMES = ("counter", "device_stamp_s", "width", "height")
_TRIAL_FIELDS = (
    "outcome",
    "force_target_n",
    "force_measured_n",
    "force_deviation_n",
    "force_drift_n",
    "contact_z_m",
    "depth_measured_m",
    "dwell_start_ns",
    "dwell_end_ns",
    "reference_start_ns",
    "reference_end_ns",
    "reason",
)


def write_csv(run: Path, out: Path) -> None:
    """Write every attempt of a run that has a recording to ``out/trial-01-attempt-1/`` and so on.

    There are ``trials.csv`` and for each attempt ``force.csv`` (raw, and with the attempt's first
    tare taken off), ``arm.csv``, the untouched images and ``frames.csv`` with their stamps.
    ``time_s`` counts from the attempt's first message, the same zero in all its files.
    ``presses.csv`` holds all samples of the attempts that count, as ``import`` takes them.

    Raises:
        RecordError: There is no recording, or no space.
    """
    store = RunStore.open(run)
    attempts = [key for key in store.paths.attempts() if store.paths.recording(*key).exists()]
    if not attempts:
        raise RecordError(
            f"{store.paths.root}: holds no recording to export",
            remedy=f"`{command_line('resume', store.paths.root)}` presses what is missing",
        )
    _write_trials(store, attempts, out / "trials.csv")
    sign, presses = store.config.force_sensor.compression_sign, []
    centre = pad_centre(store)
    for trial, attempt in attempts:
        folder = out / f"trial-{trial:02d}-attempt-{attempt}"
        recording, result = store.recording(trial, attempt), store.load_result(trial, attempt)
        if not recording.is_intact:
            logger.warning("%s: %s", recording.path, recording.describe())
        with doing(folder.name):
            _write_force(recording, result, sign, folder / "force.csv")
            _write_arm(recording, folder / "arm.csv")
            frames = list(_frame_rows(recording, folder))
            _write_table(folder / "frames.csv", ("file", "stamp_ns", "time_s", *_FRAMES), frames)
            counts = store.counting(trial)
            if result is not None and counts is not None and counts.attempt == attempt:
                other = store.imported_trials.get(trial)
                term = (other.indenter if other else "") or indenter_of(store)
                rows = _press_rows(recording, result, folder.name, frames, centre, term)
                presses += sorted(rows, key=lambda row: row[_PRESSES.index("time")])
    _write_table(out / "presses.csv", _PRESSES, presses)
    columns: dict[str, object] = {name: name for name in ("image", "press", "state", "indenter")}
    columns |= {name: {"column": name, "unit": unit} for name, unit in _UNITS.items()}
    imported = store.imported.load()
    if imported is not None and not imported.has_clock:
        del columns["time"]
    contact_n = store.config.protocol.contact_force
    write_spec(store, out, "csv", {"contact_force": f"{contact_n!r} N", "columns": columns})


_UNITS = {
    "time": "s",
    **dict.fromkeys(WRENCH[:3], "N"),
    **dict.fromkeys(WRENCH[3:], "N m"),
    **dict.fromkeys((*POSE, "contact_z", "depth"), "m"),
}
_PRESSES = ("press", "state", "indenter", "image", *_UNITS)


def _press_rows(
    recording: Recording,
    result: TrialRecord,
    folder: str,
    frames: list[list[Any]],
    centre: tuple[float, float] | None,
    term: str,
) -> Iterator[list[Any]]:
    """Yield the rows of a press: samples of force and pose, and images; what is absent is empty."""
    force, arm, windows = recording.force, recording.arm, result.windows

    def row(stamp_ns: int, rest: str, **values: float | str) -> list[Any]:
        among = {"unloaded": windows.get(rest), "pressed": windows.get("dwell")}
        within = [name for name, w in among.items() if w and w[0] <= stamp_ns <= w[1]]
        state = within[0] if within else ""
        known = {"press": result.index, "state": state, "indenter": term, **values}
        known["time"] = f"{stamp_ns // 10**9:09d}.{stamp_ns % 10**9:09d}"
        return [known.get(name, "") for name in _PRESSES]

    for stamp_ns, wrench in zip(force.stamp_ns.tolist(), force.wrench.tolist(), strict=True):
        yield row(stamp_ns, "tare", **dict(zip(WRENCH, wrench, strict=True)))
    place = np.full((len(arm.pose), 3), np.nan)
    if centre is not None and result.contact_z_m is not None:
        place = arm.pose[:, :3] - [*centre, 0.0]
    for stamp_ns, xyz in zip(arm.stamp_ns.tolist(), place.tolist(), strict=True):
        yield row(stamp_ns, "", **dict(zip(POSE, xyz, strict=True)))
    for name, stamp_ns, *_ in frames:
        values: dict[str, Any] = {"image": f"{folder}/{name}"}
        values |= {"contact_z": result.contact_z_m, "depth": result.depth_measured_m}
        yield row(stamp_ns, "reference", **{k: v for k, v in values.items() if v is not None})


def _write_trials(store: RunStore, attempts: list[tuple[int, int]], path: Path) -> None:
    rows, doubted = [], force_series(store).doubted
    for trial, attempt in attempts:
        result, accepted = store.load_result(trial, attempt), store.accepted(trial)
        is_latest = accepted is not None and accepted.attempt == attempt
        is_accepted = is_latest and (trial, attempt) not in doubted
        values = [getattr(result, name, None) for name in _TRIAL_FIELDS]
        rows.append([trial, attempt, int(is_accepted), *values])
    _write_table(path, ("trial", "attempt", "accepted", *_TRIAL_FIELDS), rows)


def _write_force(recording: Recording, result: TrialRecord | None, sign: int, path: Path) -> None:
    force = recording.force
    tare = result.tare_before if result else None
    tared = force.wrench - (np.array(tare.mean) if tare else np.full(6, np.nan))
    columns = {
        "counter": force.counter,
        **dict(zip(mcap_writer.WRENCH_FIELDS, force.wrench.T, strict=True)),
        **dict(zip(_TARED_FIELDS, tared.T, strict=True)),
        "pressing_force_n": sign * tared[:, 2],
    }
    _write_samples(path, recording, force.stamp_ns, columns)


def _write_arm(recording: Recording, path: Path) -> None:
    arm = recording.arm
    columns = {
        "controller_time_s": arm.controller_time_s,
        **dict(zip(mcap_writer.POSE_FIELDS, arm.pose.T, strict=True)),
        **dict(zip(mcap_writer.VELOCITY_FIELDS, arm.velocity.T, strict=True)),
        **dict(zip(mcap_writer.TCP_FORCE_FIELDS, arm.tcp_force.T, strict=True)),
        **{name: getattr(arm, name) for name in mcap_writer.ARM_STATES},
    }
    _write_samples(path, recording, arm.stamp_ns, columns)


def _write_samples(
    path: Path, recording: Recording, stamp_ns: Int64Array, columns: Mapping[str, AnyArray]
) -> None:
    """Write columns of samples behind their stamps."""
    time_s = np.round((stamp_ns - recording.start_ns) * 1e-9, 9)
    rows = zip(*(each.tolist() for each in (stamp_ns, time_s, *columns.values())), strict=True)
    _write_table(path, ("stamp_ns", "time_s", *columns), rows)


def _frame_rows(recording: Recording, folder: Path) -> Iterator[list[Any]]:
    """Write each frame into a folder, and yield its row."""
    for number, frame in enumerate(recording.frames(), start=1):
        path = folder / f"frame-{number:06d}.{frame.kind.replace('jpeg', 'jpg')}"
        path.write_bytes(frame.jpeg)
        time_s = f"{(frame.stamp_ns - recording.start_ns) * 1e-9:.9f}"
        row = [path.name, frame.stamp_ns, time_s]
        yield [*row, *(getattr(frame, name) for name in _FRAMES)]


def _write_table(path: Path, names: Iterable[str], rows: Iterable[Iterable[Any]]) -> None:
    """Write a table; a number that is not known is left empty."""
    known = (["" if value != value else value for value in row] for row in rows)
    write_atomically(path, as_csv([names, *known]))
