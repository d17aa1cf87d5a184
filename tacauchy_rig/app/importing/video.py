"""A video of the gel, and a force log of another clock."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.signal import correlate, correlation_lags, lfilter

from tacauchy_rig.app.importing.presses import (
    Frame,
    PressFinding,
    Recorded,
    S,
    Samples,
    Streams,
    axial_force,
    cut,
    find_presses,
    needed,
)
from tacauchy_rig.app.importing.source import IMAGE_PIXELS, LARGE_BYTES, MIB, Source
from tacauchy_rig.app.importing.table import (
    POSE,
    WRENCH,
    Column,
    SampleColumns,
    Table,
    read_columns,
    read_table,
)
from tacauchy_rig.core.arrays import FloatArray, Int64Array
from tacauchy_rig.core.config.fields import Frequency, Section
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.rgb import encode_png

FINER = 4
"""Steps of the search in an interval of the coarser signal."""
AROUND_S = 1.0
"""Before and after a press that its own offset is looked for in."""
NEAR_S = 0.3
"""Beside the offset of the whole: so far that of a press is looked for."""
NEAR_STEP_S = 0.002
BINS = 40
"""Of the first signal's values: so few that each has values of coming down and of letting go."""
LIKE = 0.6
"""Correlation of two signals of the same presses; less is of different ones."""
ALONE = 0.97
"""Of the best correlation: another offset, a press apart, has to have less."""
APART_S = 1.0
MEMORY_SHARE, MEMORY_S = 0.13, 0.2
"""Of a gel's force that fades after it was pressed, and how fast: more than gels of such sensors
are taken to, so that the truth lies between this and none."""
UNIFORM = 1.0 / math.sqrt(12.0)
"""Standard deviation of a uniform distribution of width 1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Signal:
    """A measure of contact over time; times [s] ascending, shape [n], as the values."""

    time_s: FloatArray
    value: FloatArray

    def at(self, time_s: FloatArray) -> FloatArray:
        """Return the values at times; at its ends it goes on as it is there."""
        return np.interp(time_s, self.time_s, self.value)


@dataclass(frozen=True, slots=True, kw_only=True)
class Offset:
    """What is to be added to times of the second clock for those of the first.

    Attributes:
        seconds: The offset [s].
        uncertainty_s: Standard uncertainty: scatter between presses, the coarser interval, and how
            far apart what the second may follow lies [s].
        correlation: Of both signals, with it [1].
    """

    seconds: float
    uncertainty_s: float
    correlation: float


def find_offset(
    first: Signal,
    second: Signal,
    presses_s: Sequence[tuple[float, float]],
    *,
    followed: Sequence[Signal] = (),
) -> Offset:
    """Find the offset with which two signals of the same presses fit best.

    Args:
        first: Of the clock that is kept; rises and falls as the second does.
        second: Of the clock that is to be moved.
        presses_s: Start and end of each press in the first clock [s].
        followed: What the second is a function of, in the first clock: one, or two that bound it;
            left out, it is ``first``.

    Raises:
        RecordError: They do not show the same presses, or fit with several offsets.
    """
    interval_s = float(np.median(np.diff(second.time_s)))
    coarse_s, likeness = _coarse(first, second, interval_s / FINER)
    found = np.array(
        [
            [_near(each, second, press, coarse_s) for press in presses_s]
            for each in followed or (first,)
        ]
    )
    bounds_s = np.median(found, axis=1)
    count = found.shape[1]
    scatter_s = float(found.std(axis=1, ddof=1).max()) / math.sqrt(count) if count > 1 else 0.0
    single_s = interval_s if count == 1 else 0.0  # one press shows no scatter
    apart_s = UNIFORM * float(np.ptp(bounds_s))
    return Offset(
        seconds=float(bounds_s.mean()),
        uncertainty_s=math.hypot(scatter_s, single_s, UNIFORM * interval_s, apart_s),
        correlation=likeness,
    )


def without_memory(force: Signal) -> Signal:
    """Return a force as of a gel that remembers, without what it remembers.

    A gel's force fades after it was pressed and its shape does not, so that coming down and letting
    go differ in force where they look alike. F = R + m with m' = -m / MEMORY_S + MEMORY_SHARE R',
    R the force that is left, sampled evenly.
    """
    step_s = float(np.median(np.diff(force.time_s)))
    time_s = np.arange(force.time_s[0], force.time_s[-1] + step_s, step_s)
    kept = math.exp(-step_s / MEMORY_S)
    new = MEMORY_SHARE * (1.0 - kept) * MEMORY_S / step_s
    left = lfilter([1.0, -kept], [1.0 + new, -(kept + new)], force.at(time_s))
    return Signal(time_s=time_s, value=np.asarray(left))


def _coarse(first: Signal, second: Signal, step_s: float) -> tuple[float, float]:
    """Return the offset of the largest correlation [s], and how large that is."""
    grids = [np.arange(s.time_s[0], s.time_s[-1], step_s) for s in (first, second)]
    one, other = (
        _standard(signal.at(grid)) for signal, grid in zip((first, second), grids, strict=True)
    )
    both = correlate(one, other, mode="full", method="fft") / min(len(one), len(other))
    lag_s = correlation_lags(len(one), len(other)) * step_s + grids[0][0] - grids[1][0]
    best = int(np.argmax(both))
    apart = np.abs(lag_s - lag_s[best]) > APART_S
    rival = float(both[apart].max(initial=0.0))
    if both[best] < LIKE or rival > ALONE * both[best]:
        raise RecordError(
            f"video and force log fit best with an offset of {lag_s[best]:.2f} s, where they are "
            f"correlated by {both[best]:.2f}; elsewhere by up to {rival:.2f}",
            remedy=f"both have to show the same presses ({LIKE} at least), at uneven times",
        )
    return float(lag_s[best]), float(both[best])


def _near(first: Signal, second: Signal, press_s: tuple[float, float], about_s: float) -> float:
    """Return the offset of one press alone [s].

    It is the one with which the second signal is most nearly a function of the first: coming down
    and letting go then run along one curve, whatever its shape is.
    """
    grid = np.arange(press_s[0] - AROUND_S, press_s[1] + AROUND_S, NEAR_STEP_S)
    order = np.argsort(first.at(grid), kind="stable")
    offsets = about_s + np.arange(-NEAR_S, NEAR_S, NEAR_STEP_S)
    apart = [_scatter(second.at(grid - offset)[order]) for offset in offsets]
    return float(offsets[int(np.argmin(apart))])


def _scatter(values: FloatArray) -> float:
    """Return how far values are from their means in ``BINS`` bins of equal count."""
    bins = np.array_split(values, BINS)
    return float(sum(((part - part.mean()) ** 2).sum() for part in bins))


def _standard(values: FloatArray) -> FloatArray:
    scatter = float(values.std())
    return np.asarray((values - values.mean()) / (scatter or 1.0))


FRAMES_MOST = 108_000
"""Of a video: half an hour at 60 Hz."""
KEPT_BYTES = 4096 * MIB
"""Of the frames at rest and held, as PNG."""
SMALL = (32, 24)
"""To which frames are scaled down to see when something changes [px]."""
Z = 2


class LogColumns(SampleColumns):
    """Which column of the log holds what."""

    time: Column
    force: Column


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
    felt = Signal(time_s=force.stamp_ns / S, value=axial_force(force))
    log = Signal(time_s=felt.time_s, value=np.sqrt(felt.value))
    found = find_presses(force, data.presses)
    spans_s = [(start / S, end / S) for start, end in (each.pressed for each in found)]
    seen = Signal(time_s=seen_s, value=change)
    height = None if pose is None else Signal(time_s=pose.stamp_ns / S, value=pose.value[:, Z])
    offset = find_offset(log, seen, spans_s, followed=followed(felt, height))
    frame_ns = np.asarray(np.rint((seen_s + offset.seconds) * S), dtype=np.int64)
    wanted = np.flatnonzero(needed(frame_ns, found)).tolist()
    frames = png_frames(path, data.video, {number: int(frame_ns[number]) for number in wanted})
    presses = cut(Streams(force=force, frames=frames, pose=pose), found)
    return Recorded(
        presses=presses,
        has_clock=True,
        sync_mode="contact_onset",
        unknown=tuple(_unknown(data.columns)),
        notes=(_offset_note(offset, len(presses)),),
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


def _offset_note(offset: Offset, count: int) -> str:
    return (
        f"The video's clock is {offset.seconds - 1.0:+.4f} s from the log's, found by when contact "
        f"shows in both ({count} presses, correlation {offset.correlation:.2f}); standard "
        f"uncertainty {offset.uncertainty_s * 1e3:.0f} ms, from the scatter between presses, the "
        "interval of the frames and, where the tip's height is not known, what a gel remembers. "
        "How late a frame shows the gel is part of it."
    )


def _times(table: Table, columns: LogColumns) -> FloatArray:
    time_s = read_columns(table, columns, "time")[:, 0]
    bad = np.flatnonzero(np.isnan(time_s) | (np.diff(time_s, prepend=-math.inf) <= 0.0))
    if len(bad):
        raise RecordError(
            f"{table.name} line {int(bad[0]) + 2}: its time is missing, or not after that before",
            remedy="every row needs a time, ascending",
        )
    return np.asarray(time_s - time_s[0])


def _samples(
    table: Table, columns: LogColumns, names: Sequence[str], stamp_ns: Int64Array
) -> Samples:
    """Return the rows in which the third of the named columns is known."""
    value = np.full((len(stamp_ns), 6), np.nan)
    value[:, : len(names)] = read_columns(table, columns, *names)
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


def png_frames(path: Path, name: str, stamps: Mapping[int, int]) -> tuple[Frame, ...]:
    """Return some frames of a video as PNG: they cannot be kept as they are.

    Args:
        stamps: Stamp [ns] of each wanted frame by its number.

    Raises:
        RecordError: The frames are too large or too many.
    """
    found, size, last = [], 0, max(stamps, default=-1)
    for number, frame in enumerate(video_frames(path, name)):
        if number > last:
            break
        if number not in stamps:
            continue
        png = encode_png(np.ascontiguousarray(frame[..., ::-1]))
        size += len(png)
        if size > KEPT_BYTES:
            raise RecordError(f"{name}: too many frames at rest", remedy="cut it into parts")
        read = partial(bytes, png)
        found.append(Frame(stamp_ns=stamps[number], name=f"{name} frame {number}", read=read))
    return tuple(found)
