"""Hold the force for the window that counts, while force and frames are recorded."""

from __future__ import annotations

from dataclasses import dataclass

from protocols.cycle import Cycle, Press
from protocols.steps.press import PressDrive
from protocols.window import ForceWindow, summarise


@dataclass(frozen=True, slots=True, kw_only=True)
class Dwell:
    """The window that counts.

    Attributes:
        depth_m: Mean depth below contact [m].
        settled: Whether the force had settled before it began.
        frame_count: Camera frames that arrived within it.
    """

    force: ForceWindow
    depth_m: float
    settled: bool
    frame_count: int


def hold(cycle: Cycle, drive: PressDrive, *, settled: bool) -> Dwell:
    """Hold for ``protocol.dwell_duration`` and summarise what was felt.

    Raises:
        BreachError: A limit was passed.
    """
    duration_ns = round(cycle.config.protocol.dwell_duration * 1e9)
    presses: list[Press] = []
    depths: list[float] = []
    while len(presses) < 2 or presses[-1].stamp_ns - presses[0].stamp_ns < duration_ns:
        reading = drive.turn()
        presses += reading.presses
        depths.append(drive.depth(reading))
    force = summarise(presses)
    return Dwell(
        force=force,
        depth_m=sum(depths) / len(depths),
        settled=settled,
        frame_count=cycle.rates.frame_count(force.start_ns, force.end_ns),
    )
