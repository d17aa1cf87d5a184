"""Frames of the untouched gel, taken right before the press."""

from __future__ import annotations

from dataclasses import dataclass

from protocols.cycle import Cycle
from protocols.window import listen


@dataclass(frozen=True, slots=True, kw_only=True)
class ReferenceWindow:
    """When the no-contact frames arrived, and how many."""

    start_ns: int
    end_ns: int
    frame_count: int


def take_reference(cycle: Cycle) -> ReferenceWindow:
    """Stand still for ``protocol.reference_duration``.

    Raises:
        BreachError: A limit was passed.
    """
    start_ns = cycle.rig.clock.now_ns()
    listen(cycle, cycle.config.protocol.reference_duration)
    end_ns = cycle.rig.clock.now_ns()
    return ReferenceWindow(
        start_ns=start_ns, end_ns=end_ns, frame_count=cycle.rates.frame_count(start_ns, end_ns)
    )
