"""A video of the gel, and a force log of another clock."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from pydantic import Field

from tacauchy_rig.app.importing.offset import Signal, image_change, offset_to_force
from tacauchy_rig.app.importing.presses import (
    Frame,
    PressFinding,
    Recorded,
    S,
    Samples,
    cut,
    drift_note,
    find_presses,
    needed,
)
from tacauchy_rig.app.importing.rows import POSE, WRENCH, SampleColumns, read_columns
from tacauchy_rig.app.importing.source import IMAGE_PIXELS, LARGE_BYTES, MIB, Source
from tacauchy_rig.app.importing.table import Column, Dialect, Table, read_table
from tacauchy_rig.core.arrays import FloatArray, ImageArray, Int64Array
from tacauchy_rig.core.config.fields import Frequency
from tacauchy_rig.core.errors import ConfigError, RecordError
from tacauchy_rig.core.rgb import encode_png

FRAMES_MOST = 108_000
"""Of a video: half an hour at 60 Hz."""
KEPT_BYTES = 4096 * MIB
"""Of the frames at rest and held, as PNG."""
Z = 2
EVEN_SHARE = 0.5
"""Of a video's interval: frames that are further from even times are of a clock of their own."""
WRAPS_S = tuple(2.0**bits * unit for bits in (16, 24, 31, 32) for unit in (1.0, 1e-3, 1e-6, 1e-9))
"""After which counters of that many bits and that unit begin anew [s]."""
Frames = Iterator[tuple[float, ImageArray]]
"""The time of each frame as the file states it [s], and the frame, blue first."""


class LogColumns(SampleColumns):
    """Which column of the log holds what."""

    time: Column
    force: Column


class VideoData(Dialect):
    """``[data]`` of a video with a force log."""

    video: str
    log: str
    columns: LogColumns
    frame_rate: Frequency | None = Field(default=None, gt=0.0)
    presses: PressFinding = Field(default_factory=PressFinding)


def read_video(source: Source, data: VideoData) -> Recorded:
    """Read both, find the offset of their clocks, and cut them into presses.

    Raises:
        RecordError: One is damaged, or they do not show the same presses.
    """
    path = source.path(data.video, field="data.video", most_bytes=LARGE_BYTES)
    table = read_table(source, data.log, field="data.log", dialect=data)
    begin_s, time_s, notes = _times(table, data.columns)
    stamp_ns = np.asarray(np.rint((time_s + 1.0) * S), dtype=np.int64)
    force = _samples(table, data.columns, WRENCH, stamp_ns)
    pose = None if data.columns.z is None else _samples(table, data.columns, POSE, stamp_ns)
    source.problems.refuse()
    found = find_presses(force, data.presses)
    seen, gaps = _seen(path, data)
    height = None if pose is None else Signal(time_s=pose.stamp_ns / S, value=pose.value[:, Z])
    clock = offset_to_force(force, seen, found, height=height)
    frame_ns = np.asarray(np.rint((seen.time_s + clock.offset_s) * S), dtype=np.int64)
    wanted = np.flatnonzero(needed(frame_ns, found)).tolist()
    frames = png_frames(path, data.video, {number: int(frame_ns[number]) for number in wanted})
    presses = cut(found, force, frames, pose)
    count = len(presses)
    clock = replace(clock, offset_s=clock.offset_s - 1.0 + begin_s)
    offset = (
        f"The video's clock is {clock.offset_s:+.4f} s from the log's, found by when contact "
        f"shows in both ({count} presses, correlation {clock.correlation:.2f}); standard "
        f"uncertainty {clock.uncertainty_s * 1e3:.0f} ms, from the scatter between presses, the "
        "interval of the frames and, where the tip's height is not known, what a gel remembers. "
        "How late a frame shows the gel is part of it."
    )
    unknown = ["The depth is not known."] * (pose is None)
    unknown.append("The position of a press on the pad is not known.")
    if count < 3:
        unknown.append(
            f"Whether one of the clocks runs faster is not known: {count} presses do not tell."
        )
    return Recorded(
        presses=presses,
        has_clock=True,
        sync_mode="contact_onset",
        unknown=tuple(unknown),
        notes=(offset, *gaps, *notes, *drift_note(found)),
        contact_force_n=data.presses.contact_force,
        name="video",
        clock=clock,
    )


def _times(table: Table, columns: LogColumns) -> tuple[float, FloatArray, list[str]]:
    """Return the first time of the log, times since then [s], and what is odd about them."""
    time_s = read_columns(table, columns, "time")[:, 0]
    name = columns.time.column
    if len(missing := np.flatnonzero(np.isnan(time_s))):
        table.problems.add(
            f"{table.where(int(missing[0]), name)}: its time is missing; {len(missing)} rows have "
            "none",
            remedy="every row needs a time",
        )
        return 0.0, np.arange(len(time_s), dtype=np.float64), []
    step_s = np.diff(time_s)
    for k in np.flatnonzero(step_s < 0.0).tolist():
        # A counter that begins anew steps back by its range, less a step.
        range_s = float(np.median(step_s)) - float(step_s[k])
        wraps = [each for each in WRAPS_S if abs(range_s - each) < 1e-3 * each][:1]
        told = [f", as a counter does that begins anew after {each:.6g} s" for each in wraps]
        table.problems.add(
            f"{table.where(k + 1, name)}: its time goes back by {-step_s[k]:.6g} s{''.join(told)}",
            remedy="times have to ascend: sort the rows, or add a counter's range after it began "
            "anew",
        )
    alike = int((step_s == 0.0).sum())
    if alike > len(step_s) / 2:
        table.problems.add(
            f'{table.name}, column "{name}": {alike} of {len(step_s)} times are those of the row '
            "before: too coarse to tell rest from press",
            remedy="write times with more digits",
        )
    note = f'{alike} rows of {table.name} have the time of the row before (column "{name}").'
    return float(time_s[0]), np.asarray(time_s - time_s[0]), [note] * bool(alike)


def _samples(
    table: Table, columns: LogColumns, names: Sequence[str], stamp_ns: Int64Array
) -> Samples:
    """Return the rows in which the third of the named columns is known."""
    value = np.full((len(stamp_ns), 6), np.nan)
    value[:, : len(names)] = read_columns(table, columns, *names)
    return Samples(stamp_ns=stamp_ns, value=value).where(~np.isnan(value[:, Z]))


def _video_frames(path: Path, name: str) -> Frames:
    """Yield frames that are neither too large nor too many; raises as ``png_frames``."""
    for number, (time_s, frame) in enumerate(_decoded(path, name)):
        if number >= FRAMES_MOST:
            raise RecordError(f"{name}: more than {FRAMES_MOST} frames", remedy="cut it into parts")
        if frame.shape[0] * frame.shape[1] > IMAGE_PIXELS:
            raise RecordError(f"{name}: frames of {frame.shape}", remedy="scale it down")
        yield time_s, frame


def _decoded(path: Path, name: str) -> Frames:
    """Yield frames by OpenCV; those of AV1, which it has no decoder for, by PyAV."""
    video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    try:
        code = int(video.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little", signed=True)
        if code.lower() in (b"av01", b"av1\0"):
            yield from _decoded_by_av(path, name)
            return
        while True:
            there, frame = video.read()
            if not there:
                return
            yield video.get(cv2.CAP_PROP_POS_MSEC) / 1e3, np.asarray(frame, np.uint8)
    finally:
        video.release()


def _decoded_by_av(path: Path, name: str) -> Frames:
    try:
        av: Any = import_module("av")
    except ImportError as error:
        raise ConfigError(
            f"{name}: is coded as AV1, which PyAV reads, which is not installed",
            remedy='pip install "tacauchy-rig[lerobot]", or: pip install av',
        ) from error
    try:
        with av.open(str(path)) as file:
            for frame in file.decode(video=0):
                image = np.asarray(frame.to_ndarray(format="bgr24"), np.uint8)
                yield float(frame.time or 0.0), image
    except av.FFmpegError as error:
        raise RecordError(
            f"{name}: no whole video: {str(error)[:200]}", remedy="copy it anew from its source"
        ) from error


def _seen(path: Path, data: VideoData) -> tuple[Signal, list[str]]:
    """Return how far each frame is from those of the first second, and what tells their times."""
    times, kept = [], []
    for time_s, frame in _video_frames(path, data.video):
        times.append(time_s)
        small = cv2.resize(frame, (160, 120), interpolation=cv2.INTER_AREA)
        kept.append(np.asarray(small, np.uint8))
    shown_s, note = _frame_times(np.array(times), data)
    return Signal(time_s=shown_s, value=image_change(kept, shown_s)), note


def _frame_times(own_s: FloatArray, data: VideoData) -> tuple[FloatArray, list[str]]:
    """Return times of frames [s] by the file, or by the stated rate where those are even."""
    step_s = np.diff(own_s)
    if len(own_s) < 3 or (not own_s[-1] > own_s[0] and data.frame_rate is None):
        raise RecordError(
            f"data.video: {data.video!r} gives {len(own_s)} frames, of no duration",
            remedy="give a whole video that ffmpeg reads, and data.frame_rate if it says none",
        )
    interval_s = float(np.median(step_s))
    ascends, even = bool((step_s > 0.0).all()), own_s[0] + interval_s * np.arange(len(own_s))
    is_even = bool(np.abs(own_s - even).max() <= EVEN_SHARE * interval_s)
    if data.frame_rate is not None:
        if ascends and not is_even and (gap := float(step_s.max())) > 1.5 * interval_s:
            raise RecordError(
                f"data.frame_rate: {data.frame_rate:g} Hz is stated, and the video has times of "
                f"its own with a gap of {gap:.3f} s",
                remedy="leave data.frame_rate out: the video's own times count",
            )
        return np.arange(len(own_s)) / data.frame_rate, []
    if not ascends:
        raise RecordError(
            f"data.video: the times of {data.video!r} do not ascend", remedy="state data.frame_rate"
        )
    gaps = step_s[step_s > 1.5 * interval_s]
    told = f"The video's own times were taken; they have {len(gaps)} gaps, of {gaps.sum():.2f} s."
    return own_s, [told] if len(gaps) else []


def png_frames(path: Path, name: str, stamps: Mapping[int, int]) -> list[Frame]:
    """Return some frames of a video as PNG: they cannot be kept as they are.

    Args:
        stamps: Stamp [ns] of each wanted frame by its number.

    Raises:
        RecordError: The frames are too large or too many.
        ConfigError: They are of a codec that OpenCV cannot decode, and PyAV is not there.
    """
    found: list[Frame] = []
    size, last = 0, max(stamps, default=-1)
    for number, (_, frame) in enumerate(_video_frames(path, name)):
        if number > last:
            break
        if number in stamps:
            png = encode_png(np.ascontiguousarray(frame[..., ::-1]))
            size += len(png)
            if size > KEPT_BYTES:
                raise RecordError(f"{name}: too many frames at rest", remedy="cut it into parts")
            title, read = f"{name} frame {number}", partial(bytes, png)
            found.append(Frame(stamp_ns=stamps[number], name=title, read=read))
    return found
