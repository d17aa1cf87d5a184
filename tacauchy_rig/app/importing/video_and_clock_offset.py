"""A video of the gel and a force log of another clock, and the offset of two such clocks.

It is found by when contact shows in both.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from pydantic import Field
from scipy.signal import correlate, correlation_lags, lfilter

from tacauchy_rig.app.importing import press_detection as detection
from tacauchy_rig.app.importing.source_files import IMAGE_PIXELS, LARGE_BYTES, MIB, Source, at_most
from tacauchy_rig.app.importing.table_rows import (
    POSE,
    WRENCH,
    SampleColumns,
    read_columns,
    read_times,
)
from tacauchy_rig.app.importing.text_tables import Column, Dialect, Table, read_table
from tacauchy_rig.core.arrays import FloatArray, ImageArray, Int64Array
from tacauchy_rig.core.config.field_ranges import Frequency
from tacauchy_rig.core.errors import RecordError, whole
from tacauchy_rig.core.image_codec import encode_png
from tacauchy_rig.core.run import FZ, CameraClock
from tacauchy_rig.core.versions import library

FINER = 4
"""Steps of the search in an interval of the coarser signal."""
AROUND_S = 1.0
"""Before and after a press that its own offset is looked for in."""
NEAR_S, FAR_S = 0.3, 2.0
"""Beside the offset of the whole: so far that of a press is looked for, and where that is not far
enough, since one clock runs faster."""
NEAR_STEP_S = 0.002
BINS = 40
"""Of the first signal's values: so few that each has values of coming down and of letting go."""
LIKE = 0.6
"""Correlation of two signals of the same presses; less is of different ones."""
ALONE, APART_S = 0.97, 1.0
"""Of the best correlation: another offset, so far apart, has to have less."""
RATED = 4
"""Presses that tell whether one clock runs faster: three nearly lie on a line where frames are
missing in the middle one."""
GAP = 3.0
"""Intervals of frames: a press with a longer gap has no offset of its own."""
ENOUGH = 8
"""Presses that show lost frames which the video's times do not tell: with fewer, videos of
``test_offsets`` fit that are two frames off."""
LITTLE = 0.3
"""Of a frame: a step of the clock that is larger than whole frames by more is of one more."""
MEMORY_SHARE, MEMORY_S = 0.13, 0.2
"""Of a gel's force that fades after it was pressed, and how fast: more than gels of such sensors
are taken to, so that the truth lies between this and none."""
UNFELT_S = 0.5
"""From a frame to the next force, and of frames that show contact there: the log has lost rows."""
UNIFORM = 1.0 / math.sqrt(12.0)
"""Standard deviation of a uniform distribution of width 1."""
SMALL = (32, 24)
"""To which frames are scaled down to see when something changes [px]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Signal:
    """A measure of contact over time; times [s] ascending, shape [n], as the values."""

    time_s: FloatArray
    value: FloatArray

    def at(self, time_s: FloatArray) -> FloatArray:
        """Return the values at times; at its ends it goes on as it is there."""
        return np.interp(time_s, self.time_s, self.value)


def offset_to_force(
    force: detection.Samples,
    seen: Signal,
    found: Sequence[detection.PressSpan],
    *,
    height: Signal | None = None,
    losses_show: bool = True,
) -> CameraClock:
    """Find what is to be added to times of images for those of the force.

    Offset and drift are a line through the offsets of the presses. Their standard uncertainty is of
    the scatter about it, at the press or the first frame where that is largest, the interval of the
    frames, and how far apart what an image may follow lies.

    Args:
        seen: How far the images changed, in the camera's clock.
        height: Of the tip, which images follow; without, they follow a force between one that a
            gel's memory is taken off and one that it is not.
        losses_show: Times of images would tell that frames are missing, or none are.

    Raises:
        RecordError: They do not show the same presses, fit in several ways, or may lack frames.
    """
    felt = felt_over_rests(force, found)
    followed = [felt, without_memory(felt)]
    if height is not None:
        followed = [Signal(time_s=height.time_s, value=-height.value)]
    presses_s = [
        (start / detection.S, end / detection.S) for start, end in (each.pressed for each in found)
    ]
    interval_s = float(np.median(np.diff(seen.time_s)))
    coarse_s = _coarse(root_of(felt), seen, interval_s / FINER)
    whole_s = [each for each in presses_s if _is_whole(seen.time_s + coarse_s, each, interval_s)]
    if not whole_s:
        raise RecordError(
            f"the video shows no press whole: of each, frames are missing for {GAP:g} intervals",
            remedy="record force and images for at least a second before and after each press",
        )
    for within_s in (NEAR_S, FAR_S):
        offsets_s = np.array(
            [[_near(f, seen, press, coarse_s, within_s) for press in whole_s] for f in followed]
        )
        if np.abs(offsets_s - coarse_s).max() < 0.9 * within_s:
            break
    at_s = np.mean(whole_s, axis=1) - offsets_s.mean(axis=0) - seen.time_s[0]
    clock = _clock(offsets_s, at_s, interval_s, losses_show=losses_show)
    moved = Signal(time_s=aligned(seen.time_s, clock), value=seen.value)
    return replace(clock, correlation=likeness(root_of(felt), moved, 0.0))


def _clock(
    offsets_s: FloatArray, at_s: FloatArray, interval_s: float, *, losses_show: bool
) -> CameraClock:
    """Fit offset and drift to the offsets of presses; the correlation is left open.

    Args:
        offsets_s: By what an image follows and press, shape [followed, n].
        at_s: When the presses were, after the first frame, shape [n].

    Raises:
        RecordError: They scatter about the line, or leave room for frames that are missing.
    """
    terms = np.vander(at_s, 2 if len(at_s) >= RATED else 1)
    line, free = np.linalg.lstsq(terms, offsets_s.T)[0], max(1, len(terms) - terms.shape[1])
    left_s = offsets_s.T - terms @ line
    rms_s = math.sqrt(float((left_s**2).sum(axis=0).max()) / free)
    reached = np.vstack([terms, np.eye(terms.shape[1])[-1]])  # each press, and the first frame
    apart_s = float(np.ptp(reached @ line, axis=1).max())
    hidden = 0.0 if losses_show else _hidden(offsets_s.mean(axis=0) / interval_s, terms, reached)
    rate = np.polyfit(at_s, offsets_s.mean(axis=0), min(1, len(at_s) - 1))
    swayed_s = np.polyval(rate, np.append(at_s, 0.0)) - (reached @ line).mean(axis=1)
    most_s = max(float(np.abs(each).max()) for each in (left_s, swayed_s))
    off_s = math.hypot(hidden * interval_s, most_s, apart_s / 2.0)
    if off_s > interval_s:
        advance_s = 1.0 + (float(rate[0]) if len(rate) > 1 else 0.0)
        raise RecordError(
            f"offsets of the clocks, one a press, scatter by {rms_s:.3f} s, so that an image may "
            f"be {off_s:.3f} s off; frames are {interval_s:.3f} s apart. The log's clock advances "
            f"by {advance_s:.4f} s a second of the camera's",
            remedy="frames were dropped, or their rate is wrong: on average there are "
            f"{1.0 / (advance_s * interval_s):.3f} a second; state that as data.frame_rate, or cut "
            "the video where frames are missing",
        )
    if not losses_show and (len(terms) < ENOUGH or hidden > 0.0):
        raise RecordError(
            "data.complete: the video's frames have no times of their own, and its "
            f"{len(terms)} presses do not show whether some are missing",
            remedy="state data.complete = true if the recorder drops no frames; if it may, record "
            f"{ENOUGH} presses or more, or a video that holds the time of each frame",
        )
    leverage = np.einsum("ij,jk,ik->i", reached, np.linalg.inv(terms.T @ terms), reached)
    scatter_s = rms_s * math.sqrt(float(leverage.max()))
    single_s = interval_s if len(terms) == 1 else 0.0  # one press shows no scatter
    spread_s = UNIFORM * math.hypot(interval_s, apart_s)
    *drift, offset_s = line.mean(axis=1).tolist()
    return CameraClock(
        offset_s=offset_s,
        drift=sum(drift),
        uncertainty_s=math.hypot(scatter_s, single_s, spread_s),
        correlation=math.nan,
    )


def _hidden(offsets: FloatArray, terms: FloatArray, reached: FloatArray) -> float:
    """Return how many frames an image is off if some are missing in one place, the worst of all.

    They are missing within a press, which then has half of the step, or between two. The step fits
    the offsets, in frames, best.
    """
    if len(terms) == 1:
        return 0.0
    later = np.tri(len(terms), k=-1)
    steps = np.hstack([later + 0.5 * np.eye(len(terms)), later[:, :-1]])
    fitted = np.linalg.pinv(terms) @ steps
    left = steps - terms @ fitted
    missing = np.ceil(np.abs(offsets @ left) / (left**2).sum(axis=0) - LITTLE)
    true = [np.pad(end(steps), ((0, 1), (0, 0))) for end in (np.floor, np.ceil)]
    return float((missing * np.abs(reached @ fitted - true).max(axis=(0, 1))).max())


def aligned(time_s: FloatArray, clock: CameraClock) -> FloatArray:
    """Return the log's times of images [s], shape [n], from those of the camera."""
    return np.asarray(time_s + clock.offset_s + clock.drift * (time_s - time_s[0]))


def felt_over_rests(force: detection.Samples, found: Sequence[detection.PressSpan]) -> Signal:
    """Return how much is felt [N] over a zero that goes evenly from rest to rest."""
    rests = [each.rest for each in found]
    middles = [sum(rest) / 2.0 for rest in rests]
    zero = np.interp(force.stamp_ns, middles, [detection.zero_of(force, rest) for rest in rests])
    return Signal(time_s=force.stamp_ns / detection.S, value=np.abs(force.value[:, FZ] - zero))


def root_of(felt: Signal) -> Signal:
    """Return the root of a force: an image changes about as it does."""
    return Signal(time_s=felt.time_s, value=np.sqrt(felt.value))


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


def image_change(frames: Iterable[ImageArray], time_s: FloatArray) -> FloatArray:
    """Return how far each frame is from those of the first second [grey level].

    Args:
        time_s: Of each frame [s]; those that come late in a stream may be more than there are.
    """
    small = [
        cv2.resize(frame, SMALL, interpolation=cv2.INTER_AREA).astype(np.float64)
        for frame in frames
    ]
    if not small:
        return np.empty(0)
    stacked, times = np.stack(small), np.asarray(time_s)[: len(small)]
    rest = np.median(stacked[times <= times[0] + 1.0], axis=0)
    return np.asarray(np.sqrt(np.mean((stacked - rest) ** 2, axis=(1, 2, 3))))


def likeness(first: Signal, second: Signal, offset_s: float) -> float:
    """Return the correlation of two signals where both are, with an offset."""
    time_s = second.time_s + offset_s
    inside = (time_s >= first.time_s[0]) & (time_s <= first.time_s[-1])
    one, other = _standard(first.at(time_s[inside])), _standard(second.value[inside])
    return float(np.mean(one * other)) if inside.any() else 0.0


def _standard(values: FloatArray) -> FloatArray:
    return np.asarray((values - values.mean()) / (float(values.std()) or 1.0))


def _coarse(first: Signal, second: Signal, step_s: float) -> float:
    """Return the offset of the largest correlation [s]."""
    grids = [np.arange(s.time_s[0], s.time_s[-1], step_s) for s in (first, second)]
    one, other = _standard(first.at(grids[0])), _standard(second.at(grids[1]))
    both = correlate(one, other, mode="full", method="fft") / min(len(one), len(other))
    lag_s = correlation_lags(len(one), len(other)) * step_s + grids[0][0] - grids[1][0]
    best = int(np.argmax(both))
    rival = float(both[np.abs(lag_s - lag_s[best]) > APART_S].max(initial=0.0))
    like = likeness(first, second, float(lag_s[best]))
    if like < LIKE or rival > ALONE * both[best]:
        raise RecordError(
            f"video and force log fit best with an offset of {lag_s[best]:.2f} s, where they are "
            f"correlated by {like:.2f}; another offset fits {100.0 * rival / both[best]:.0f} % "
            "as well",
            remedy=f"both have to show the same presses ({LIKE} at least), at uneven times; if "
            "frames were dropped, state their mean rate as data.frame_rate",
        )
    return float(lag_s[best])


def _is_whole(time_s: FloatArray, press_s: tuple[float, float], interval_s: float) -> bool:
    """Return whether frames are missing of a press for no longer than ``GAP`` intervals."""
    inside = time_s[(time_s > press_s[0]) & (time_s < press_s[1])]
    return bool(np.diff([press_s[0], *inside, press_s[1]]).max() <= GAP * interval_s)


def _near(
    first: Signal, second: Signal, press_s: tuple[float, float], about_s: float, within_s: float
) -> float:
    """Return the offset of one press alone [s].

    It is the one with which the second signal is most nearly a function of the first: coming down
    and letting go then run along one curve, whatever its shape is.
    """
    grid = np.arange(press_s[0] - AROUND_S, press_s[1] + AROUND_S, NEAR_STEP_S)
    order = np.argsort(first.at(grid), kind="stable")
    offsets = about_s + np.arange(-within_s, within_s, NEAR_STEP_S)
    bins = np.split(order, np.linspace(0, len(grid), BINS, endpoint=False).astype(np.int64)[1:])
    # An offset shows what the next one shows a step later.
    steps_s = NEAR_STEP_S * np.arange(len(grid) + len(offsets) - 1)
    shown = second.at(grid[0] - offsets[-1] + steps_s)[::-1]
    windows = sliding_window_view(shown, len(offsets))[::-1]
    explained = sum(windows[part].sum(axis=0) ** 2 / len(part) for part in bins)
    apart = np.convolve(shown**2, np.ones(len(grid)), "valid") - explained
    return float(offsets[int(np.argmin(apart))])


FRAMES_MOST = 108_000
"""Of a video: half an hour at 60 Hz."""
KEPT_BYTES = 4096 * MIB
"""Of the frames at rest and held, as PNG."""
Z = 2
COUNTED_S = 1.5e-3
"""From even times: those of frames that were only counted are rounded to a millisecond."""
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
    complete: bool = False
    presses: detection.PressFinding = Field(default_factory=detection.PressFinding)


def read_video(source: Source, data: VideoData) -> detection.Recorded:
    """Read both, find the offset of their clocks, and cut them into presses.

    Raises:
        RecordError: One is damaged, or they do not show the same presses.
    """
    path = source.path(data.video, field="data.video", most_bytes=LARGE_BYTES)
    table = read_table(source, data.log, field="data.log", dialect=data)
    begin_s, time_s, notes = _times(table, data.columns)
    stamp_ns = np.asarray(np.rint((time_s + 1.0) * detection.S), dtype=np.int64)
    force = _samples(table, data.columns, WRENCH, stamp_ns, notes)
    pose = None if data.columns.z is None else _samples(table, data.columns, POSE, stamp_ns, notes)
    source.problems.refuse()
    found = detection.find_presses(force, data.presses)
    seen, shows, told = _seen(path, data)
    height = (
        None if pose is None else Signal(time_s=pose.stamp_ns / detection.S, value=pose.value[:, Z])
    )
    clock = offset_to_force(force, seen, found, height=height, losses_show=shows or data.complete)
    frame_ns = np.asarray(np.rint(aligned(seen.time_s, clock) * detection.S), dtype=np.int64)
    wanted = np.flatnonzero(detection.needed(frame_ns, found)).tolist()
    frames = png_frames(path, data.video, {number: int(frame_ns[number]) for number in wanted})
    presses = detection.cut(found, force, frames, pose)
    count = len(presses)
    clock = replace(clock, offset_s=clock.offset_s - 1.0 + begin_s)
    offset = (
        f"The video's clock is {clock.offset_s:+.4f} s from the log's at its first frame, and "
        f"{clock.drift:+.5f} s a second further, found by when contact "
        f"shows in both ({count} presses, correlation {clock.correlation:.2f}); standard "
        f"uncertainty {clock.uncertainty_s * 1e3:.0f} ms, from the scatter between presses, the "
        "interval of the frames and, where the tip's height is not known, what a gel remembers. "
        "How late a frame shows the gel is part of it."
    )
    rate = f"Whether one of the clocks runs faster is not known: {count} presses do not tell."
    return detection.Recorded(
        presses=presses,
        has_clock=True,
        sync_mode="contact_onset",
        unknown=(rate,) * (count < RATED),
        notes=(
            offset,
            *told,
            *notes,
            *detection.drift_note(found),
            *lost_contact(seen, frame_ns, force, found, data.log),
        ),
        contact_force_n=data.presses.contact_force,
        name="video",
        clock=clock,
    )


def lost_contact(
    seen: Signal,
    frame_ns: Int64Array,
    force: detection.Samples,
    found: Sequence[detection.PressSpan],
    log: str,
) -> Iterator[str]:
    """Yield that frames change by more than half of what presses do where the log has no force."""
    inside = [
        [(frame_ns >= start) & (frame_ns <= end) for start, end in windows]
        for windows in ([each.rest for each in found], [each.held for each in found])
    ]
    rest, held = (seen.value[np.logical_or.reduce(each)] for each in inside)
    if not len(rest) or not len(held):
        return
    after = np.clip(np.searchsorted(force.stamp_ns, frame_ns), 1, len(force.stamp_ns) - 1)
    off_ns = np.abs(np.stack([force.stamp_ns[after - 1], force.stamp_ns[after]]) - frame_ns)
    is_far = off_ns.min(axis=0) > UNFELT_S * detection.S
    unfelt = is_far & (seen.value > (np.median(rest) + np.median(held)) / 2.0)
    shown_s = float(unfelt.sum() * np.median(np.diff(seen.time_s)))
    if shown_s > UNFELT_S:
        first_s = float(seen.time_s[unfelt][0])
        yield (
            f"The video shows contact for {shown_s:.1f} s, first at {first_s:.2f} s of its time, "
            f"where {log} has no force: presses there are lost. If rows are missing, give the "
            "whole log (data.log)."
        )


def _times(table: Table, columns: LogColumns) -> tuple[float, FloatArray, list[str]]:
    """Return the first time of the log, times since then [s], and what is odd about them."""
    name = columns.time.column
    time_s = read_times(table, columns, name)
    if time_s is None:
        return 0.0, np.arange(len(table.rows), dtype=np.float64), []
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
    table: Table, columns: LogColumns, names: Sequence[str], stamp_ns: Int64Array, notes: list[str]
) -> detection.Samples:
    """Return the rows in which the third of the named columns is known; others are noted."""
    value = np.full((len(stamp_ns), 6), np.nan)
    value[:, : len(names)] = read_columns(table, columns, *names)
    where = f"{table.name}, data.columns.{names[Z]}"
    known = ~np.isnan(value[:, Z])
    return detection.known_samples(stamp_ns, value, known, where, notes)


def _video_frames(path: Path, name: str) -> Frames:
    """Yield frames that are neither too large nor too many; raises as ``png_frames``."""
    for number, (time_s, frame) in enumerate(_decoded(path, name)):
        at_most(FRAMES_MOST, number + 1, f"{name}: {number + 1} frames or more")
        pixels = frame.shape[0] * frame.shape[1]
        at_most(IMAGE_PIXELS, pixels, f"{name}: frames of {pixels} px", remedy="scale it down")
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
    av = library("av", extra="lerobot")
    with whole(name, "video"), av.open(str(path)) as file:
        for frame in file.decode(video=0):
            image = np.asarray(frame.to_ndarray(format="bgr24"), np.uint8)
            yield float(frame.time or 0.0), image


def _seen(path: Path, data: VideoData) -> tuple[Signal, bool, list[str]]:
    """Return how far frames are from those at first, whether times tell losses, and notes."""
    times, kept = [], []
    for time_s, frame in _video_frames(path, data.video):
        times.append(time_s)
        small = cv2.resize(frame, (160, 120), interpolation=cv2.INTER_AREA)
        kept.append(np.asarray(small, np.uint8))
    shown_s, shows, told = _frame_times(np.array(times), data)
    return Signal(time_s=shown_s, value=image_change(kept, shown_s)), shows, told


def _frame_times(own_s: FloatArray, data: VideoData) -> tuple[FloatArray, bool, list[str]]:
    """Return times of frames [s] by the file or the stated rate, and whether they tell losses."""
    step_s = np.diff(own_s)
    if len(own_s) < 3 or (not own_s[-1] > own_s[0] and data.frame_rate is None):
        raise RecordError(
            f"data.video: {data.video!r} gives {len(own_s)} frames, of no duration",
            remedy="give a whole video that ffmpeg reads, and data.frame_rate if it says none",
        )
    interval_s = float(np.median(step_s))
    ascends = bool((step_s > 0.0).all())
    told = ["That the recorder dropped no frames is stated (data.complete)."] * data.complete
    if data.frame_rate is not None:
        if ascends and (gap := float(step_s.max())) > 1.5 * interval_s:
            raise RecordError(
                f"data.frame_rate: {data.frame_rate:g} Hz is stated, and the video has times of "
                f"its own with a gap of {gap:.3f} s",
                remedy="leave data.frame_rate out: the video's own times count",
            )
        return np.arange(len(own_s)) / data.frame_rate, False, told
    if not ascends:
        raise RecordError(
            f"data.video: the times of {data.video!r} do not ascend", remedy="state data.frame_rate"
        )
    gaps = step_s[step_s > 1.5 * interval_s]
    note = f"The video's own times were taken; gaps: {len(gaps)}, {gaps.sum():.2f} s in all."
    even_s = np.linspace(own_s[0], own_s[-1], len(own_s))
    shows = bool(np.abs(own_s - even_s).max() > COUNTED_S)
    return own_s, shows, [*told, *[note] * bool(len(gaps))]


def png_frames(path: Path, name: str, stamps: Mapping[int, int]) -> list[detection.Frame]:
    """Return some frames of a video as PNG: they cannot be kept as they are.

    Args:
        stamps: Stamp [ns] of each wanted frame by its number.

    Raises:
        RecordError: The frames are too large or too many.
        ConfigError: They are of a codec that OpenCV cannot decode, and PyAV is not there.
    """
    found: list[detection.Frame] = []
    size, last = 0, max(stamps, default=-1)
    for number, (_, frame) in enumerate(_video_frames(path, name)):
        if number > last:
            break
        if number in stamps:
            png = encode_png(np.ascontiguousarray(frame[..., ::-1]))
            size += len(png)
            at_most(KEPT_BYTES, size, f"{name}: {size} bytes of frames at rest and held or more")
            title, read = f"{name} frame {number}", partial(bytes, png)
            found.append(detection.Frame(stamp_ns=stamps[number], name=title, read=read))
    return found
