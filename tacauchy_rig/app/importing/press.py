"""Presses of others, as every format gives them: samples and frames with stamps, windows, words."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from tacauchy_rig.core.arrays import FloatArray, Int64Array

Window = tuple[int, int]
"""First and last stamp [ns], both included."""
ORDER_NS = 1_000_000
"""Between the stamps of what has no time: they tell nothing but the order."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Samples:
    """A stream of numbers.

    Attributes:
        stamp_ns: Of the source's clock, ascending, shape [n].
        value: Fx, Fy, Fz [N], Mx, My, Mz [N m], or x, y, z [m] and rotation vector [rad], shape
            [n, 6]; NaN where the source does not tell.
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
        depth_m: Stated depth [m], where no pose tells it.
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
        has_clock: Stamps are times; without, they tell nothing but the order.
        sync_mode: What ties forces and images together in time (``run.sync_mode``).
        unknown: What it does not tell, a sentence each.
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
