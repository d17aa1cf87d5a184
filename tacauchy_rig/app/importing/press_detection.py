"""Presses of others: samples and frames with stamps, and where presses are in a recording."""

import math
import statistics
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from pydantic import Field

from tacauchy_rig.core.arrays import BoolArray, FloatArray, Int64Array
from tacauchy_rig.core.config.field_ranges import Force, Section
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import FZ, CameraClock

Window = tuple[int, int]
"""First and last stamp [ns], both included."""
ORDER_NS = 1_000_000
"""Between the stamps of what has no time: they give the order only."""
S = 1_000_000_000
"""Nanoseconds of a second."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Samples:
    """A stream of numbers."""

    stamp_ns: Int64Array  # of the source's clock, ascending, shape [n]
    # Fx, Fy, Fz [N], Mx, My, Mz [N m], or x, y, z [m] and rotation vector [rad], shape [n, 6]; NaN
    # where the source does not say
    value: FloatArray

    def within(self, window: Window) -> Self:
        """Return the samples of a window."""
        return self.where((self.stamp_ns >= window[0]) & (self.stamp_ns <= window[1]))

    def where(self, kept: BoolArray) -> Self:
        """Return some of the samples."""
        return replace(self, stamp_ns=self.stamp_ns[kept], value=self.value[kept])


def known_samples(
    stamp_ns: Int64Array, value: FloatArray, known: BoolArray, where: str, notes: list[str]
) -> Samples:
    """Return the samples that are known; how many were left out is noted."""
    if lost := int((~known).sum()):
        notes.append(f"{where}: {lost} of {len(known)} samples, no finite numbers, were left out.")
    return Samples(stamp_ns=stamp_ns[known], value=value[known])


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """An image of the source."""

    stamp_ns: int
    name: str  # what the source calls it, for messages
    read: Callable[[], bytes]  # returns its bytes, JPEG or PNG


@dataclass(frozen=True, slots=True, kw_only=True)
class Press:
    """One press."""

    name: str  # what the source calls it
    frames: tuple[Frame, ...]  # all of its images, in order
    reference: Window  # window of the frames without contact
    dwell: Window  # window in which the press was held
    force: Samples | None = None  # raw wrenches; None where there are none
    pose: Samples | None = None  # of the tip; None where there are none
    tare: Window | None = None  # window of unloaded force samples; None takes forces as they are
    contact_z_m: float | None = None  # height of the tip at first contact [m]
    depth_m: float | None = None  # stated depth [m], where no pose gives it
    place_m: tuple[float, float] | None = None  # beside the pad's centre [m]; None is not known
    indenter: str = ""  # as ``press --indenter`` has it; empty is the run's
    where: str = ""  # where the source has it, for messages; empty is its name
    indenter_at: str = ""  # where the source names its indenter
    # Column, row and radius of the contact's edge as drawn into the image [px]
    contact_px: tuple[float, float, float] | None = None

    @property
    def held(self) -> FloatArray | None:
        """Wrenches over the dwell above the press's zero, shape [n, 6]; None where none are."""
        value = None if self.force is None else self.force.within(self.dwell).value
        if self.force is None or value is None or not len(value):
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
    """All that was read of a source."""

    presses: tuple[Press, ...]
    has_clock: bool  # stamps are times; without, they give the order only
    sync_mode: str = "unknown"  # what ties forces and images together in time (``run.sync_mode``)
    unknown: tuple[str, ...] = ()  # what the source does not say, a sentence each
    notes: tuple[str, ...] = ()  # what was made of it, a sentence each
    # Fields of ``rig.toml`` that its format comes with; ``import.toml`` counts more
    rig: Mapping[str, Any] = field(default_factory=dict)
    contact_force_n: float | None = None  # at which depths begin [N]; None is first touch
    name: str = "imported"  # of a run of it
    # How the camera's clock was aligned with the force's; None where nothing was
    clock: CameraClock | None = None


REST_NS = S
"""Of a rest: long enough to average noise, too short for a cell's drift."""
APART_NS = S // 5
"""Between a rest and the press after it, so that no approach is taken for rest."""
SHORTEST_NS = 3 * S // 10
"""Of a press: what is shorter is a knock."""
SMOOTHED = 9
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


class PressFinding(Section):
    """``[data.presses]``: how presses are found in a recording, which begins with less force."""

    press_force: Force = Field(default=0.2, validate_default=False)
    contact_force: Force = Field(default=0.05, validate_default=False)
    held_share: float = Field(default=0.99, gt=0.0, lt=1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class PressSpan:
    """When a press was, in the clock of the force."""

    name: str  # for messages, with its time
    rest: Window  # quiet time before it, for zero and no-contact frames
    pressed: Window  # from its first force to its last
    held: Window  # the longest stretch with nearly its largest force
    touched_ns: int  # when the gel was touched
    drift_n_s: float = 0.0  # how fast the cell's zero drifts from this rest to the next [N/s]


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
    begin_ns = int(force.stamp_ns[0])
    windows = _loaded_windows(force, finding)
    if not 0 < len(windows) < MAX_PRESSES:
        largest_n = _axial_force(force, (begin_ns, begin_ns + REST_NS)).max()
        raise RecordError(
            f"the force is above data.presses.press_force ({finding.press_force:g} N) in "
            f"{len(windows)} stretches; the largest is {largest_n:.3g} N",
            remedy="set data.presses.press_force between the noise and the weakest press",
        )
    found, free_ns = [], begin_ns
    for number, pressed in enumerate(windows, start=1):
        name = f"press {number}, {(pressed[0] - begin_ns) / S:.2f} s from the start"
        rest = _rest(force, (free_ns, pressed[0] - APART_NS), finding, name)
        found.append(_span(name, force, rest, pressed, finding))
        free_ns = pressed[1] + APART_NS
    rests = [each.rest for each in found]
    with suppress(RecordError):  # none is needed behind the last press
        rests.append(_rest(force, (free_ns, int(force.stamp_ns[-1])), finding, "the end"))
    rates = np.diff([zero_of(force, rest) for rest in rests]) / np.diff(np.mean(rests, axis=1) / S)
    rates = np.append(rates, rates[-1:] if len(rates) else 0.0)[: len(found)]
    during_n = np.abs(rates) * [(each.held[1] - each.rest[0]) / S for each in found]
    rates = np.where(during_n > DRIFT_TOLD * finding.contact_force, rates, 0.0)
    return [replace(each, drift_n_s=r) for each, r in zip(found, rates.tolist(), strict=True)]


def zero_of(force: Samples, rest: Window) -> float:
    """Return the force along the axis at rest [N]."""
    return float(np.median(force.within(rest).value[:, FZ]))


def _axial_force(force: Samples, rest: Window) -> FloatArray:
    """Return how much is felt along the axis above a rest [N]."""
    return np.asarray(np.abs(force.value[:, FZ] - zero_of(force, rest)))


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


def _loaded_windows(force: Samples, finding: PressFinding) -> list[Window]:
    """Return when a force is above a level, over a zero that is followed from rest to rest.

    A press is over where less than half of the force that begins one is left, or little of its own
    largest. The zero is the median of the last second at rest, so that one that drifts neither
    begins a press nor keeps one from ending.
    """
    stamp_ns, axis = _blocks(force)
    zero = float(np.median(axis[stamp_ns <= stamp_ns[0] + REST_NS]))
    rest = settling = deque[tuple[int, float]]()
    rest_ns = REST_NS
    windows: list[Window] = []
    start = ended = None
    peak, least = 0.0, RELEASED * finding.press_force
    for now, value in zip(stamp_ns.tolist(), axis.tolist(), strict=True):
        felt = abs(value - zero)
        if start is None:
            if felt > finding.press_force:
                start, peak = now, felt
            elif felt < least:
                zero = statistics.median(_newest(rest, now, value, rest_ns))
        elif ended is None:
            peak = max(peak, felt)
            if felt < max(least, RELEASED_SHARE * peak):
                ended, settling = now, deque()
        else:
            settled = _newest(settling, now, value, SHORTEST_NS)
            if felt > max(finding.press_force, 2.0 * RELEASED_SHARE * peak):
                ended = None  # no rest between: one stretch, of which _check_one thinks its own
            elif now - ended >= APART_NS and max(settled) - min(settled) < least:
                windows.append((start, ended))
                start = ended = None
                zero, rest, rest_ns = statistics.median(settled), settling, SHORTEST_NS
    if start is not None:
        windows.append((start, ended or int(stamp_ns[-1])))
    return [window for window in windows if window[1] - window[0] >= SHORTEST_NS]


def _newest(held: deque[tuple[int, float]], now: int, value: float, length_ns: int) -> list[float]:
    """Take a value, and return those of the newest stretch of time."""
    held.append((now, value))
    while held[0][0] < now - length_ns:
        held.popleft()
    return [each for _, each in held]


def _blocks(force: Samples) -> tuple[Int64Array, FloatArray]:
    """Return times and medians of the force along the axis in blocks of ``BLOCK_NS``."""
    number = (force.stamp_ns - force.stamp_ns[0]) // BLOCK_NS
    begins = np.flatnonzero(np.diff(number, prepend=-1))
    counts = np.diff(begins, append=len(number))
    ordered = force.value[np.lexsort((force.value[:, FZ], number)), FZ]
    middle = ordered[begins + (counts - 1) // 2] + ordered[begins + counts // 2]
    return force.stamp_ns[begins], middle / 2.0


def _stretches(stamp_ns: Int64Array, inside: BoolArray) -> list[Window]:
    """Return the windows of neighbouring samples that are all inside."""
    kept = np.flatnonzero(inside)
    pieces = np.split(kept, np.flatnonzero(np.diff(kept) > 1) + 1)
    return [(int(stamp_ns[piece[0]]), int(stamp_ns[piece[-1]])) for piece in pieces if len(piece)]


def _longest(windows: Sequence[Window]) -> Window:
    return max(windows, key=lambda window: window[1] - window[0])


def _smooth(values: FloatArray) -> FloatArray:
    from scipy.ndimage import median_filter  # noqa: PLC0415 - a table of means needs none

    return np.asarray(median_filter(values, SMOOTHED, mode="nearest"))


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
    is_quiet = np.abs(axis - np.median(axis)) < 0.5 * finding.contact_force
    quiet = _stretches(gap.stamp_ns, np.asarray(is_quiet))
    long = [(end - REST_NS, end) for start, end in quiet if end - start >= REST_NS]
    return long[-1] if long else _longest(quiet)


def _span(
    name: str, force: Samples, rest: Window, pressed: Window, finding: PressFinding
) -> PressSpan:
    stamp_ns, force_n = force.stamp_ns, _axial_force(force, rest)
    inside = (stamp_ns >= pressed[0]) & (stamp_ns <= pressed[1])
    own_ns, smooth = stamp_ns[inside], _smooth(force_n[inside])
    _check_one(name, (own_ns - pressed[0]) / S, smooth)
    before = (stamp_ns >= rest[1]) & (stamp_ns <= pressed[0])
    below = np.flatnonzero(before & (force_n < finding.contact_force))
    return PressSpan(
        name=name,
        rest=rest,
        pressed=pressed,
        held=_longest(_stretches(own_ns, smooth >= finding.held_share * smooth.max())),
        touched_ns=int(stamp_ns[below[-1]]) if len(below) else pressed[0],
    )


def _check_one(name: str, time_s: FloatArray, force_n: FloatArray) -> None:
    """Refuse a stretch in which the force falls deeply between two peaks: it is two presses."""
    before = np.maximum.accumulate(force_n)
    after = np.maximum.accumulate(force_n[::-1])[::-1]
    low = np.flatnonzero(force_n < VALLEY * np.minimum(before, after))
    if len(low):
        k = low[np.argmin(force_n[low])]
        raise RecordError(
            f"{name}: the force falls from {before[k]:.3g} N to {force_n[k]:.3g} N and rises to "
            f"{after[k]:.3g} N again, {time_s[k]:.1f} s after it "
            "began: several presses without a rest between them",
            remedy="record a second without contact between presses, or cut the recording there",
        )


def cut(
    found: Sequence[PressSpan],
    force: Samples,
    frames: Sequence[Frame],
    pose: Samples | None = None,
    *,
    pad_centre: tuple[float, float] | None = None,
) -> tuple[Press, ...]:
    """Return the presses of a recording in one clock, each with its rest before it.

    Args:
        frames: In order of time.
        pose: Of the tip; None where nobody recorded it.
        pad_centre: Where the tip's x and y are above the pad's centre [m]; None is not known.
    """
    presses = []
    for span in found:
        rest, whole = span.rest, (span.rest[0], span.pressed[1])
        own = tuple(each for each in frames if whole[0] <= each.stamp_ns <= whole[1])
        felt = force.within(whole)
        felt.value[:, FZ] -= span.drift_n_s * (felt.stamp_ns - sum(rest) / 2.0) / S
        moved = None if pose is None else pose.within(whole)
        held = np.empty((0, 6)) if moved is None else moved.within(span.held).value
        place = None
        if pad_centre is not None and len(held):
            x, y = (held[:, :2].mean(axis=0) - pad_centre).tolist()
            place = (x, y)
        presses.append(
            Press(
                name=span.name,
                frames=own,
                reference=rest,
                dwell=span.held,
                force=felt,
                pose=moved if moved is not None and len(moved.stamp_ns) else None,
                tare=rest,
                contact_z_m=_height(moved, span.touched_ns),
                place_m=place,
            )
        )
    return tuple(presses)


def _height(pose: Samples | None, at_ns: int) -> float | None:
    """Return the height of the tip at a time [m]; None where it is not known."""
    if pose is None or len(pose.stamp_ns) < 2 or not pose.stamp_ns[0] <= at_ns <= pose.stamp_ns[-1]:
        return None
    height = float(np.interp(at_ns, pose.stamp_ns, pose.value[:, 2]))
    return None if math.isnan(height) else height
