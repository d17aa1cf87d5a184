"""Presses of others: samples and frames with stamps, and where presses are in a recording."""

from __future__ import annotations

import math
import statistics
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from pydantic import Field

from tacauchy_rig.core.arrays import BoolArray, FloatArray, Int64Array
from tacauchy_rig.core.config.fields import Force, Section
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.imported import CameraClock
from tacauchy_rig.core.run import FZ

Window = tuple[int, int]
"""First and last stamp [ns], both included."""
ORDER_NS = 1_000_000
"""Between the stamps of what has no time: they give the order only."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Samples:
    """A stream of numbers.

    Attributes:
        stamp_ns: Of the source's clock, ascending, shape [n].
        value: Fx, Fy, Fz [N], Mx, My, Mz [N m], or x, y, z [m] and rotation vector [rad], shape
            [n, 6]; NaN where the source does not say.
    """

    stamp_ns: Int64Array
    value: FloatArray

    def within(self, window: Window) -> Samples:
        """Return the samples of a window."""
        inside = (self.stamp_ns >= window[0]) & (self.stamp_ns <= window[1])
        return Samples(stamp_ns=self.stamp_ns[inside], value=self.value[inside])


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """An image of the source.

    Attributes:
        name: What the source calls it, for messages.
        read: Returns its bytes, JPEG or PNG.
    """

    stamp_ns: int
    name: str
    read: Callable[[], bytes]


@dataclass(frozen=True, slots=True, kw_only=True)
class Press:
    """One press.

    Attributes:
        name: What the source calls it.
        frames: All of its images, in order.
        force: Raw wrenches; None where there are none.
        pose: Of the tip; None where there are none.
        reference: Window of the frames without contact.
        dwell: Window in which the press was held.
        tare: Window of unloaded force samples; None takes forces as they are.
        contact_z_m: Height of the tip at first contact [m].
        depth_m: Stated depth [m], where no pose gives it.
        place_m: Beside the pad's centre [m]; None is not known.
        indenter: As ``press --indenter`` has it; empty is the run's.
        where: Where the source has it, for messages; empty is its name.
        indenter_at: Where the source names its indenter.
        contact_px: Column, row and radius of the contact's edge as drawn into the image [px].
    """

    name: str
    frames: tuple[Frame, ...]
    reference: Window
    dwell: Window
    force: Samples | None = None
    pose: Samples | None = None
    tare: Window | None = None
    contact_z_m: float | None = None
    depth_m: float | None = None
    place_m: tuple[float, float] | None = None
    indenter: str = ""
    where: str = ""
    indenter_at: str = ""
    contact_px: tuple[float, float, float] | None = None

    @property
    def held(self) -> FloatArray | None:
        """Wrenches over the dwell above the press's zero, shape [n, 6]; None where none are."""
        if self.force is None:
            return None
        value = self.force.within(self.dwell).value
        if not len(value):
            return None
        zero = 0.0 if self.tare is None else self.force.within(self.tare).value.mean(axis=0)
        return np.asarray(value - zero)

    @property
    def measured_depth_m(self) -> float | None:
        """Of the tip below first contact [m], by its pose or as stated."""
        if self.pose is None or self.contact_z_m is None:
            return self.depth_m
        z = self.pose.within(self.dwell).value[:, 2]
        return self.contact_z_m - float(z.mean()) if len(z) else self.depth_m


@dataclass(frozen=True, slots=True, kw_only=True)
class Recorded:
    """All that was read of a source.

    Attributes:
        has_clock: Stamps are times; without, they give the order only.
        sync_mode: What ties forces and images together in time (``run.sync_mode``).
        unknown: What the source does not say, a sentence each.
        notes: What was made of it, a sentence each.
        contact_force_n: At which depths begin [N]; None is first touch.
        name: Of a run of it.
        rig: Fields of ``rig.toml`` that its format comes with; ``import.toml`` counts more.
        clock: How the camera's clock was aligned with the force's; None where nothing was.
    """

    presses: tuple[Press, ...]
    has_clock: bool
    sync_mode: str = "unknown"
    unknown: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    rig: Mapping[str, Any] = field(default_factory=dict)
    contact_force_n: float | None = None
    name: str = "imported"
    clock: CameraClock | None = None


S = 1_000_000_000
"""Nanoseconds of a second."""
REST_NS = S
"""Of a rest: long enough to average noise, too short for a cell's drift."""
APART_NS = S // 5
"""Between a rest and the press after it, so that no approach is taken for rest."""
SHORTEST_NS = 3 * S // 10
"""Of a press: what is shorter is a knock."""
HALF = 4
SMOOTHED = 2 * HALF + 1
"""Samples of force whose median decides where it is held: one that jumps does not."""
RELEASED = 0.5
"""Of the force that begins a press: below it the press is over, so noise makes no second one."""
RELEASED_SHARE = 0.15
"""Of a press's own largest force: below it the press is over too, since a zero drifts meanwhile."""
BLOCK_NS = S // 50
"""Of the medians in which presses are looked for: a zero is followed from one to the next."""
DRIFT_TOLD = 0.2
"""Of the force of contact: a zero that drifts by more during a press is taken off."""
VALLEY = 0.5
"""Of the lower of two peaks: a force that falls below it between them is of two presses."""
MAX_PRESSES = 10_000


def _text(quantity: str) -> Any:
    """Return a default as a file would have it, which is read as one."""
    return Field(default=quantity, validate_default=True)


class PressFinding(Section):
    """How presses are found in a recording.

    Attributes:
        press_force: More than this is a press; the recording begins with less.
        contact_force: Depth counts from here.
        held_share: Of a press's largest force: as long as there is more, it is held.
    """

    press_force: Force = _text("0.2 N")
    contact_force: Force = _text("0.05 N")
    held_share: float = Field(default=0.99, gt=0.0, lt=1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Streams:
    """All of a recording, in one clock.

    Attributes:
        force: Raw wrenches.
        frames: In order of time.
        pose: Of the tip; None where nobody recorded it.
    """

    force: Samples
    frames: Sequence[Frame]
    pose: Samples | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PressSpan:
    """When a press was, in the clock of the force.

    Attributes:
        name: For messages, with its time.
        rest: Quiet time before it, for zero and no-contact frames.
        pressed: From its first force to its last.
        held: The longest stretch with nearly its largest force.
        touched_ns: When the gel was touched.
        drift_n_s: How fast the cell's zero drifts from this rest to the next [N/s].
    """

    name: str
    rest: Window
    pressed: Window
    held: Window
    touched_ns: int
    drift_n_s: float = 0.0


def find_presses(force: Samples, finding: PressFinding) -> list[PressSpan]:
    """Find when a recording's presses were.

    Raises:
        RecordError: There is no force, no press, or no rest before one.
    """
    if len(force.stamp_ns) < SMOOTHED:
        raise RecordError(
            f"the recording has {len(force.stamp_ns)} samples of force, too few to find a press",
            remedy="check the name of the force's topic or column",
        )
    spans = _loaded_windows(force, finding)
    if not 0 < len(spans) < MAX_PRESSES:
        raise RecordError(
            f"the force is above data.presses.press_force ({finding.press_force:g} N) in "
            f"{len(spans)} stretches; the largest is {axial_force(force).max():.3g} N",
            remedy="set data.presses.press_force between the noise and the weakest press",
        )
    found, free_ns = [], int(force.stamp_ns[0])
    for number, pressed in enumerate(spans, start=1):
        name = f"press {number}, {(pressed[0] - int(force.stamp_ns[0])) / S:.2f} s from the start"
        rest = _rest(force, (free_ns, pressed[0] - APART_NS), finding, name)
        found.append(_span(name, force, rest, pressed, finding))
        free_ns = pressed[1] + APART_NS
    rests = [each.rest for each in found]
    with suppress(RecordError):  # none is needed behind the last press
        rests.append(_rest(force, (free_ns, int(force.stamp_ns[-1])), finding, "the end"))
    rates = [_drift(force, *each, finding) for each in zip(found, rests[1:], strict=False)]
    rates += [rates[-1] if rates else 0.0] * (len(found) - len(rates))
    return [replace(span, drift_n_s=rate) for span, rate in zip(found, rates, strict=True)]


def _drift(force: Samples, span: PressSpan, later: Window, finding: PressFinding) -> float:
    """Return how fast the zero drifts from a press's rest to a later one [N/s]; 0 if hardly."""
    zeros = [np.median(force.within(rest).value[:, FZ]) for rest in (span.rest, later)]
    apart_s = (sum(later) - sum(span.rest)) / 2.0 / S
    rate = float(zeros[1] - zeros[0]) / apart_s if apart_s > 0.0 else 0.0
    during = abs(rate) * (span.held[1] - span.rest[0]) / S
    return rate if during > DRIFT_TOLD * finding.contact_force else 0.0


def drift_note(found: Sequence[PressSpan]) -> list[str]:
    """Return what was made of a zero that drifts, a sentence; none where it does not."""
    during = [abs(each.drift_n_s) * (each.held[1] - each.rest[1]) / S for each in found]
    note = (
        f"The cell's zero drifts, by up to {max(during):.3f} N from a rest until the press after "
        "it was held: it was taken to drift evenly from rest to rest, and taken off."
    )
    return [note] * any(during)


def needed(stamp_ns: Int64Array, found: Sequence[PressSpan]) -> BoolArray:
    """Return at which stamps some press is held, or at rest before it."""
    windows = [window for each in found for window in (each.rest, each.held)]
    inside = [(stamp_ns >= start) & (stamp_ns <= end) for start, end in windows]
    return np.asarray(np.logical_or.reduce(inside, axis=0))


def cut(streams: Streams, found: Sequence[PressSpan]) -> tuple[Press, ...]:
    """Return the presses of a recording, each with its rest before it.

    Raises:
        RecordError: One has no image of the gel at rest.
    """
    return tuple(_press(streams, each) for each in found)


def _loaded_windows(force: Samples, finding: PressFinding) -> list[Window]:
    """Return when a force is above a level, over a zero that is followed from rest to rest.

    A press is over where less than half of the force that begins one is left, or little of its own
    largest. The zero is the median of the last second at rest, so that one that drifts neither
    begins a press nor keeps one from ending.
    """
    stamp_ns, axis = _blocks(force)
    zero = float(np.median(axis[stamp_ns <= stamp_ns[0] + REST_NS]))
    rest, settling = _Recent(REST_NS), _Recent(SHORTEST_NS)
    windows: list[Window] = []
    start = ended = None
    peak, least = 0.0, RELEASED * finding.press_force
    for now, value in zip(stamp_ns.tolist(), axis.tolist(), strict=True):
        felt = abs(value - zero)
        if start is None:
            if felt > finding.press_force:
                start, peak = now, felt
            elif felt < least:
                rest.add(now, value)
                zero = rest.median
        elif ended is None:
            peak = max(peak, felt)
            if felt < max(least, RELEASED_SHARE * peak):
                ended, settling = now, _Recent(SHORTEST_NS)
        else:
            settling.add(now, value)
            if felt > max(finding.press_force, 2.0 * RELEASED_SHARE * peak):
                ended = None  # no rest between: one stretch, of which _check_one thinks its own
            elif now - ended >= APART_NS and settling.range < least:
                windows.append((start, ended))
                start = ended = None
                zero, rest = settling.median, settling
    if start is not None:
        windows.append((start, ended or int(stamp_ns[-1])))
    return [window for window in windows if window[1] - window[0] >= SHORTEST_NS]


class _Recent:
    """Values of the newest stretch of time [ns]."""

    def __init__(self, length_ns: int) -> None:
        self._length_ns = length_ns
        self._held: deque[tuple[int, float]] = deque()

    def add(self, now: int, value: float) -> None:
        self._held.append((now, value))
        while self._held[0][0] < now - self._length_ns:
            self._held.popleft()

    @property
    def median(self) -> float:
        return statistics.median(value for _, value in self._held)

    @property
    def range(self) -> float:
        values = [value for _, value in self._held]
        return max(values) - min(values)


def _blocks(force: Samples) -> tuple[Int64Array, FloatArray]:
    """Return times and medians of the force along the axis in blocks of ``BLOCK_NS``."""
    number = (force.stamp_ns - force.stamp_ns[0]) // BLOCK_NS
    begins = np.flatnonzero(np.diff(number, prepend=-1))
    parts = np.split(force.value[:, FZ], begins[1:])
    return force.stamp_ns[begins], np.array([float(np.median(part)) for part in parts])


def axial_force(force: Samples, rest: Window | None = None) -> FloatArray:
    """Return how much is felt along the axis [N]; zero is that of a rest, or of the start."""
    axis, start_ns = force.value[:, FZ], force.stamp_ns[0]
    zero = rest or (start_ns, start_ns + REST_NS)
    return np.asarray(np.abs(axis - np.median(force.within(zero).value[:, FZ])))


def _rest(force: Samples, free: Window, finding: PressFinding, name: str) -> Window:
    """Return the last quiet second of the time before a press, or the longest quiet there is.

    Quiet is what is within half the force of contact of the median: who looks for the gel touches
    it for a moment, and a cell's zero drifts.
    """
    gap = force.within(free)
    if len(gap.stamp_ns) < SMOOTHED:
        raise RecordError(
            f"{name}: {len(gap.stamp_ns)} samples of force without contact before it",
            remedy="record at least a second without contact before each press",
        )
    axis = _smooth(gap.value[:, FZ])
    quiet = np.flatnonzero(np.abs(axis - np.median(axis)) < 0.5 * finding.contact_force)
    pieces = np.split(quiet, np.flatnonzero(np.diff(quiet) > 1) + 1)
    ends = [gap.stamp_ns[piece[[0, -1]]].tolist() for piece in pieces if len(piece)]
    long = [(end - REST_NS, end) for start, end in ends if end - start >= REST_NS]
    start, end = long[-1] if long else max(ends, key=lambda pair: pair[1] - pair[0])
    return int(start), int(end)


def _span(
    name: str, force: Samples, rest: Window, pressed: Window, finding: PressFinding
) -> PressSpan:
    stamp_ns, force_n = force.stamp_ns, axial_force(force, rest)
    _check_one(name, stamp_ns, force_n, pressed)
    return PressSpan(
        name=name,
        rest=rest,
        pressed=pressed,
        held=_held(stamp_ns, force_n, pressed, finding.held_share),
        touched_ns=_touched(stamp_ns, force_n, pressed, rest[1], finding.contact_force),
    )


def _check_one(name: str, stamp_ns: Int64Array, force_n: FloatArray, pressed: Window) -> None:
    """Refuse a stretch in which the force falls deeply between two peaks.

    Raises:
        RecordError: It does: these are several presses without a rest between them.
    """
    inside = (stamp_ns >= pressed[0]) & (stamp_ns <= pressed[1])
    smooth = _smooth(force_n[inside])
    before = np.maximum.accumulate(smooth)
    after = np.maximum.accumulate(smooth[::-1])[::-1]
    low = np.flatnonzero(smooth < VALLEY * np.minimum(before, after))
    if len(low):
        k = low[np.argmin(smooth[low])]
        raise RecordError(
            f"{name}: the force falls from {before[k]:.3g} N to {smooth[k]:.3g} N and rises to "
            f"{after[k]:.3g} N again, {(stamp_ns[inside][k] - pressed[0]) / S:.1f} s after it "
            "began: several presses without a rest between them",
            remedy="record a second without contact between presses, or cut the recording there",
        )


def _press(streams: Streams, found: PressSpan) -> Press:
    rest, whole = found.rest, (found.rest[0], found.pressed[1])
    frames = tuple(f for f in streams.frames if whole[0] <= f.stamp_ns <= whole[1])
    unloaded = [f.stamp_ns for f in frames if f.stamp_ns <= rest[1]]
    if not unloaded:
        raise RecordError(
            f"{found.name}: no image of the gel at rest before it",
            remedy="record images for at least a second without contact before each press",
        )
    pose = None if streams.pose is None else streams.pose.within(whole)
    force = streams.force.within(whole)
    since_s = (force.stamp_ns - sum(rest) / 2.0) / S
    force.value[:, FZ] -= found.drift_n_s * since_s
    return Press(
        name=found.name,
        frames=frames,
        reference=(unloaded[0], unloaded[-1]),
        dwell=found.held,
        force=force,
        pose=pose if pose is not None and len(pose.stamp_ns) else None,
        tare=rest,
        contact_z_m=_height(pose, found.touched_ns),
    )


def _held(stamp_ns: np.ndarray, force_n: FloatArray, pressed: Window, share: float) -> Window:
    """Return the longest stretch of a press with nearly its largest force."""
    inside = np.flatnonzero((stamp_ns >= pressed[0]) & (stamp_ns <= pressed[1]))
    smooth = _smooth(force_n[inside])
    high = np.flatnonzero(smooth >= share * smooth.max())
    pieces = np.split(high, np.flatnonzero(np.diff(high) > 1) + 1)
    longest = max(
        pieces, key=lambda piece: stamp_ns[inside[piece[-1]]] - stamp_ns[inside[piece[0]]]
    )
    return int(stamp_ns[inside[longest[0]]]), int(stamp_ns[inside[longest[-1]]])


def _smooth(values: FloatArray) -> FloatArray:
    padded = np.pad(values, HALF, mode="edge")
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, SMOOTHED), axis=1))


def _touched(
    stamp_ns: np.ndarray, force_n: FloatArray, pressed: Window, after_ns: int, contact_n: float
) -> int:
    """Return when the force passed that of contact for good, before it was a press."""
    before = (stamp_ns >= after_ns) & (stamp_ns <= pressed[0])
    below = np.flatnonzero(before & (force_n < contact_n))
    return int(stamp_ns[below[-1]]) if len(below) else pressed[0]


def _height(pose: Samples | None, at_ns: int) -> float | None:
    """Return the height of the tip at a time [m]; None where it is not known."""
    if pose is None or len(pose.stamp_ns) < 2 or not pose.stamp_ns[0] <= at_ns <= pose.stamp_ns[-1]:
        return None
    height = float(np.interp(at_ns, pose.stamp_ns, pose.value[:, 2]))
    return None if math.isnan(height) else height
