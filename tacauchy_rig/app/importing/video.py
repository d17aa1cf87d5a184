"""A video of the gel, and a force log of another clock."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tacauchy_rig.app.importing.onset import Offset, Signal, find_offset, without_memory
from tacauchy_rig.app.importing.press import Frame, Recorded, Samples, Window
from tacauchy_rig.app.importing.source import IMAGE_PIXELS, LARGE_BYTES, MIB, Source
from tacauchy_rig.app.importing.spec import Column
from tacauchy_rig.app.importing.streams import (
    PressFinding,
    S,
    Streams,
    cut,
    felt_along,
    find_presses,
)
from tacauchy_rig.app.importing.table import Table, read_table
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.config.fields import Frequency, Section
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.quantities import Dimension
from tacauchy_rig.core.rgb import encode_png

FRAMES_MOST = 108_000
"""Of a video: half an hour at 60 Hz."""
KEPT_BYTES = 4096 * MIB
"""Of the frames at rest and held, as PNG."""
SMALL = (32, 24)
"""To which frames are scaled down to see when something changes [px]."""
WRENCH = ("force_x", "force_y", "force", "moment_x", "moment_y", "moment_z")
POSE = ("x", "y", "z")
Z = 2


class LogColumns(Section):
    """Which column of the log says what, and in which unit; as those of a CSV's folder."""

    time: Column
    force: Column
    force_x: Column | None = None
    force_y: Column | None = None
    moment_x: Column | None = None
    moment_y: Column | None = None
    moment_z: Column | None = None
    x: Column | None = None
    y: Column | None = None
    z: Column | None = None


class VideoData(Section):
    """``[data]`` of a video with a force log.

    Attributes:
        video: As ffmpeg reads it.
        log: A CSV.
        frame_rate: Of the video; left out, what the file says.
    """

    video: str
    log: str
    columns: LogColumns
    frame_rate: Frequency | None = None
    presses: PressFinding = Field(default_factory=PressFinding)


def read_video(source: Source, data: VideoData) -> Recorded:
    """Read both, find the offset of their clocks, and cut them into presses.

    Raises:
        RecordError: One is damaged, or they do not show the same presses.
    """
    table = read_table(source, data.log, field="data.log")
    time_s = _times(table, data.columns)
    stamp_ns = np.asarray(np.rint((time_s + 1.0) * S), dtype=np.int64)
    force = _samples(table, data.columns, WRENCH, stamp_ns)
    pose = None if data.columns.z is None else _samples(table, data.columns, POSE, stamp_ns)
    path = source.path(data.video, field="data.video", most_bytes=LARGE_BYTES)
    seen_s, change = _changes(path, data)
    felt = Signal(time_s=force.stamp_ns / S, value=felt_along(force))
    log = Signal(time_s=felt.time_s, value=np.sqrt(felt.value))
    found = find_presses(force, data.presses)
    spans_s = [(start / S, end / S) for start, end in (each.pressed for each in found)]
    seen = Signal(time_s=seen_s, value=change)
    height = None if pose is None else Signal(time_s=pose.stamp_ns / S, value=pose.value[:, Z])
    offset = find_offset(log, seen, spans_s, followed=followed(felt, height))
    frame_ns = np.asarray(np.rint((seen_s + offset.seconds) * S), dtype=np.int64)
    windows = [window for each in found for window in (each.rest, each.held)]
    frames = _kept(path, data, frame_ns, windows)
    presses = cut(Streams(force=force, frames=frames, pose=pose), found)
    return Recorded(
        presses=presses,
        has_clock=True,
        sync_mode="contact_onset",
        unknown=tuple(_unknown(data.columns)),
        notes=(_told(offset, len(presses)),),
        contact_force_n=data.presses.contact_force,
        name="video",
    )


def followed(felt: Signal, height: Signal | None) -> tuple[Signal, ...]:
    """Return what an image follows: how deep the tip is, or forces that bound a gel's memory."""
    if height is None:
        return felt, without_memory(felt)
    return (Signal(time_s=height.time_s, value=-height.value),)


def _unknown(columns: LogColumns) -> Iterator[str]:
    if columns.z is None:
        yield "The depth is not known."
    yield "Where on the pad was pressed is not known."


def _told(offset: Offset, count: int) -> str:
    return (
        f"The video's clock is {offset.seconds - 1.0:+.4f} s from the log's, found by when contact "
        f"shows in both ({count} presses, correlation {offset.correlation:.2f}); standard "
        f"uncertainty {offset.uncertainty_s * 1e3:.0f} ms, from the scatter between presses, the "
        "interval of the frames and, where the tip's height is not known, what a gel remembers. "
        "How late a frame shows the gel is part of it."
    )


def _times(table: Table, columns: LogColumns) -> FloatArray:
    time_s = np.array(table.numbers(columns.time, Dimension.TIME, field="data.columns.time"))
    bad = np.flatnonzero(np.isnan(time_s) | (np.diff(time_s, prepend=-math.inf) <= 0.0))
    if len(bad):
        raise RecordError(
            f"{table.name} line {int(bad[0]) + 2}: its time is missing, or not after that before",
            remedy="every row needs a time, ascending",
        )
    return np.asarray(time_s - time_s[0])


def _samples(
    table: Table, columns: LogColumns, names: Sequence[str], stamp_ns: NDArray[np.int64]
) -> Samples:
    """Return the rows in which the last named but one of three is known."""
    value = np.full((len(stamp_ns), 6), np.nan)
    for place, name in enumerate(names):
        dimension = (
            Dimension.LENGTH
            if name in POSE
            else Dimension.TORQUE
            if name.startswith("moment")
            else Dimension.FORCE
        )
        field = f"data.columns.{name}"
        value[:, place] = table.numbers(getattr(columns, name), dimension, field=field)
    known = ~np.isnan(value[:, 2])
    return Samples(stamp_ns=stamp_ns[known], value=value[known])


def video_frames(path: Path, name: str) -> Iterator[NDArray[np.uint8]]:
    """Yield a video's frames, blue first.

    Raises:
        RecordError: They are too large, or too many.
    """
    video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    try:
        for _ in range(FRAMES_MOST):
            there, frame = video.read()
            if not there:
                return
            if frame.shape[0] * frame.shape[1] > IMAGE_PIXELS:
                raise RecordError(f"{name}: frames of {frame.shape}", remedy="scale it down")
            yield np.asarray(frame, np.uint8)
        raise RecordError(f"{name}: more than {FRAMES_MOST} frames", remedy="cut it into parts")
    finally:
        video.release()


def _changes(path: Path, data: VideoData) -> tuple[FloatArray, FloatArray]:
    """Return times of the frames [s], and how far each is from those of the first second."""
    video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    rate_hz = data.frame_rate or float(video.get(cv2.CAP_PROP_FPS))
    video.release()
    change = image_change(video_frames(path, data.video), rate_hz)
    if len(change) < 3 or not 0.0 < rate_hz < 1e4:  # frames a second that any camera has
        raise RecordError(
            f"data.video: {data.video!r} gives {len(change)} frames at {rate_hz:g} Hz",
            remedy="give a whole video that ffmpeg reads, and data.frame_rate if it says none",
        )
    return np.arange(len(change)) / rate_hz, change


def image_change(frames: Iterable[NDArray[np.uint8]], rate_hz: float) -> FloatArray:
    """Return how far each frame is from those of the first second [grey level]."""
    small = [
        cv2.resize(frame, SMALL, interpolation=cv2.INTER_AREA).astype(np.float64)
        for frame in frames
    ]
    if not small:
        return np.empty(0)
    stacked = np.stack(small)
    rest = np.median(stacked[: max(1, round(min(rate_hz, len(small))))], axis=0)
    return np.asarray(np.sqrt(np.mean((stacked - rest) ** 2, axis=(1, 2, 3))))


def _kept(
    path: Path, data: VideoData, frame_ns: NDArray[np.int64], windows: Sequence[Window]
) -> tuple[Frame, ...]:
    """Return the frames at rest and held, as PNG: a video's frames cannot be kept as they are."""
    wanted = np.zeros(len(frame_ns), dtype=np.bool_)
    for start, end in windows:
        wanted |= (frame_ns >= start) & (frame_ns <= end)
    found, size = [], 0
    for number, frame in enumerate(video_frames(path, data.video)):
        if wanted[number]:
            png = encode_png(np.ascontiguousarray(frame[..., ::-1]))
            size += len(png)
            name, stamp = f"{data.video} frame {number}", int(frame_ns[number])
            found.append(Frame(stamp_ns=stamp, name=name, read=partial(bytes, png)))
        if size > KEPT_BYTES:
            raise RecordError(f"{data.video}: too many frames at rest", remedy="cut it into parts")
    return tuple(found)
