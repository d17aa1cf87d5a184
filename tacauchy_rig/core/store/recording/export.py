"""Handing a run to other tools: force and arm as CSV, frames as JPEG files."""

from __future__ import annotations

import csv
import logging
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tacauchy_rig.core.arrays import FloatArray, Int64Array
from tacauchy_rig.core.errors import RecordError, command_line
from tacauchy_rig.core.run import TrialRecord
from tacauchy_rig.core.store.durable import write_error
from tacauchy_rig.core.store.force_series import force_series
from tacauchy_rig.core.store.recording.messages import (
    ARM_STATES,
    POSE_FIELDS,
    TCP_FORCE_FIELDS,
    VELOCITY_FIELDS,
    WRENCH_FIELDS,
)
from tacauchy_rig.core.store.recording.reading import Recording
from tacauchy_rig.core.store.run_store import RunStore

logger = logging.getLogger(__name__)

_TARED_FIELDS = tuple(f"{name}_tared" for name in WRENCH_FIELDS)
_FRAME_FIELDS = ("counter", "device_stamp_s", "width", "height")
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


def export_run(root: Path, out: Path, *, images: bool = False) -> list[Path]:
    """Write every attempt that has a recording to ``out/trial-01-attempt-1/`` and so on.

    There are ``trials.csv`` and for each attempt ``force.csv`` (raw, and with the attempt's first
    tare taken off) and ``arm.csv``; ``images`` instead gives the untouched JPEG frames and
    ``frames.csv`` with their stamps. ``time_s`` counts from the attempt's first message, the same
    zero in all its files.

    Returns:
        The CSV files and image folders that were written.

    Raises:
        RecordError: No run folder, no recording in it, a file exists already, or no space.
    """
    store = RunStore.open(root)
    attempts = [key for key in store.paths.attempts() if store.paths.recording(*key).exists()]
    if not attempts:
        raise RecordError(
            f"{root}: holds no recording to export",
            remedy=f"`{command_line('resume', root)}` presses the trials that are missing",
        )
    written = [] if images else [_write_trials(store, attempts, out / "trials.csv")]
    for trial, attempt in attempts:
        folder = out / f"trial-{trial:02d}-attempt-{attempt}"
        recording = Recording.open(store.paths.recording(trial, attempt))
        if not recording.is_intact:
            logger.warning("%s: %s", recording.path, recording.describe())
        if images:
            written.append(_write_frames(recording, folder))
        else:
            result = store.load_result(trial, attempt)
            sign = store.config.force_sensor.compression_sign
            written.append(_write_force(recording, result, sign, folder / "force.csv"))
            written.append(_write_arm(recording, folder / "arm.csv"))
    return written


def _write_trials(store: RunStore, attempts: list[tuple[int, int]], path: Path) -> Path:
    rows, doubted = [], force_series(store).doubted
    for trial, attempt in attempts:
        result, accepted = store.load_result(trial, attempt), store.accepted(trial)
        is_latest = accepted is not None and accepted.attempt == attempt
        is_accepted = is_latest and (trial, attempt) not in doubted
        values = [getattr(result, name, None) for name in _TRIAL_FIELDS]
        rows.append([trial, attempt, int(is_accepted), *values])
    return _write_table(path, ("trial", "attempt", "accepted", *_TRIAL_FIELDS), rows)


def _write_force(recording: Recording, result: TrialRecord | None, sign: int, path: Path) -> Path:
    force = recording.force()
    tare = result.tare_before if result else None
    tared = force.wrench - (np.array(tare.mean) if tare else np.full(6, np.nan))
    columns = {
        "stamp_ns": force.stamp_ns,
        "time_s": _times(recording, force.stamp_ns),
        "counter": force.counter,
        **dict(zip(WRENCH_FIELDS, force.wrench.T, strict=True)),
        **dict(zip(_TARED_FIELDS, tared.T, strict=True)),
        "pressing_force_n": sign * tared[:, 2],
    }
    return _write_columns(path, columns)


def _write_arm(recording: Recording, path: Path) -> Path:
    arm = recording.arm()
    columns = {
        "stamp_ns": arm.stamp_ns,
        "time_s": _times(recording, arm.stamp_ns),
        "controller_time_s": arm.controller_time_s,
        **dict(zip(POSE_FIELDS, arm.pose.T, strict=True)),
        **dict(zip(VELOCITY_FIELDS, arm.velocity.T, strict=True)),
        **dict(zip(TCP_FORCE_FIELDS, arm.tcp_force.T, strict=True)),
        **{name: getattr(arm, name) for name in ARM_STATES},
    }
    return _write_columns(path, columns)


def _write_columns(path: Path, columns: Mapping[str, FloatArray | Int64Array]) -> Path:
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    return _write_table(path, columns, rows)


def _write_frames(recording: Recording, folder: Path) -> Path:
    rows = _frame_rows(recording, folder)
    _write_table(folder / "frames.csv", ("file", "stamp_ns", "time_s", *_FRAME_FIELDS), rows)
    return folder


def _frame_rows(recording: Recording, folder: Path) -> Iterator[list[Any]]:
    """Write each frame beside the table, and yield its row."""
    for number, frame in enumerate(recording.frames(), start=1):
        path = folder / f"frame-{number:06d}.jpg"
        try:
            path.write_bytes(frame.jpeg)
        except OSError as error:
            raise write_error(path, error) from error
        time_s = f"{(frame.stamp_ns - recording.start_ns) * 1e-9:.9f}"
        row = [path.name, frame.stamp_ns, time_s]
        yield [*row, *(getattr(frame, name) for name in _FRAME_FIELDS)]


def _times(recording: Recording, stamps: Int64Array) -> FloatArray:
    return np.round((stamps - recording.start_ns) * 1e-9, 9)


def _write_table(path: Path, names: Iterable[str], rows: Iterable[Iterable[Any]]) -> Path:
    """Write a table; a number that is not known is left empty."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("x", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(names)
            for row in rows:
                writer.writerow("" if value != value else value for value in row)
    except FileExistsError as error:
        raise RecordError(
            f"{path}: exists already", remedy="name a new folder to export to"
        ) from error
    except OSError as error:
        raise write_error(path, error) from error
    return path
