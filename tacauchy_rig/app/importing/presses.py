"""Presses of others: samples and frames with stamps, and where presses are in a recording."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pydantic import Field

from tacauchy_rig.core.arrays import BoolArray, FloatArray, Int64Array
from tacauchy_rig.core.config.fields import Force, Section
from tacauchy_rig.core.errors import RecordError
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
    contact_px: tuple[float, float, float] | None = None


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
    """

    presses: tuple[Press, ...]
    has_clock: bool
    sync_mode: str = "unknown"
    unknown: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    rig: Mapping[str, Any] = field(default_factory=dict)
    contact_force_n: float | None = None
    name: str = "imported"


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
    """

    name: str
    rest: Window
    pressed: Window
    held: Window
    touched_ns: int


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
    force_n = axial_force(force)
    spans = list(_loaded_windows(force.stamp_ns, force_n, finding.press_force))
    if not 0 < len(spans) < MAX_PRESSES:
        raise RecordError(
            f"the force is above data.presses.press_force ({finding.press_force:g} N) in "
            f"{len(spans)} stretches; the largest is {force_n.max():.3g} N",
            remedy="set data.presses.press_force between the noise and the weakest press",
        )
    found, free_ns = [], int(force.stamp_ns[0])
    for number, pressed in enumerate(spans, start=1):
        name = f"press {number}, {(pressed[0] - int(force.stamp_ns[0])) / S:.2f} s from the start"
        rest = _rest(force, (free_ns, pressed[0] - APART_NS), finding, name)
        found.append(_span(name, force, rest, pressed, finding))
        free_ns = pressed[1] + APART_NS
    return found


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


def _loaded_windows(stamp_ns: np.ndarray, force_n: FloatArray, above: float) -> Iterator[Window]:
    """Yield when a signal is above a level, from there until it falls below half of it."""
    inside, start = False, 0
    for index in np.flatnonzero((force_n > above) | (force_n < RELEASED * above)).tolist():
        if force_n[index] > above and not inside:
            inside, start = True, index
        elif inside and force_n[index] < RELEASED * above:
            inside = False
            if stamp_ns[index] - stamp_ns[start] >= SHORTEST_NS:
                yield int(stamp_ns[start]), int(stamp_ns[index])
    if inside and stamp_ns[-1] - stamp_ns[start] >= SHORTEST_NS:
        yield int(stamp_ns[start]), int(stamp_ns[-1])


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
    return PressSpan(
        name=name,
        rest=rest,
        pressed=pressed,
        held=_held(stamp_ns, force_n, pressed, finding.held_share),
        touched_ns=_touched(stamp_ns, force_n, pressed, rest[1], finding.contact_force),
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
    return Press(
        name=found.name,
        frames=frames,
        reference=(unloaded[0], unloaded[-1]),
        dwell=found.held,
        force=streams.force.within(whole),
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
