"""What an emulated arm truly did after a moment, and how hard it truly pressed.

Both come from the emulator's own trace of the arm and from the emulated gel, not from anything
that the program under test has measured.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from drivers.emulators.plant.gel import Plant
from tacauchy_rig.core.run import Pose, Vector3
from tests.drivers.arm_notes import TraceRow

STILL_M_S = 1e-7
REST_NS = 100_000_000
"""Standing still for so long counts as a stop."""
FORCE_STEP_NS = 4_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmOutcome:
    """How the arm behaved from a moment on.

    Attributes:
        speed_before_m_s: Speed at the moment.
        stopped_after_s: Until it stood still; None when it never did.
        descended_m: How far down it went before it stood still, at most.
        lowered_after_m: How far down it went after it had stood still, at most.
        raised_after_m: How far up it was in the end above where it stood still.
        rest_ns: When it stood still first; None when it never did.
        at_rest: Whether it stood still in the end.
        end_z_m: Height of the tip in the end.
    """

    speed_before_m_s: float
    stopped_after_s: float | None
    descended_m: float
    lowered_after_m: float
    raised_after_m: float
    rest_ns: int | None
    at_rest: bool
    end_z_m: float


def arm_after(rows: Sequence[TraceRow], stamp_ns: int, *, now_ns: int) -> ArmOutcome:
    """Return what the arm did after ``stamp_ns``, as far as its trace goes at ``now_ns``.

    Raises:
        IndexError: The trace holds nothing before the moment.
    """
    start = [row for row in rows if row.stamp_ns <= stamp_ns][-1]
    after = [row for row in rows if row.stamp_ns > stamp_ns]
    rest_ns = _first_rest_ns(start, after, stamp_ns, now_ns)
    end_ns = now_ns if rest_ns is None else rest_ns
    until_rest = [start.position[2], *(r.position[2] for r in after if r.stamp_ns <= end_ns)]
    later = [until_rest[-1], *(r.position[2] for r in after if r.stamp_ns > end_ns)]
    return ArmOutcome(
        speed_before_m_s=_speed(start),
        stopped_after_s=None if rest_ns is None else (rest_ns - stamp_ns) * 1e-9,
        descended_m=max(0.0, start.position[2] - min(until_rest)),
        lowered_after_m=until_rest[-1] - min(later),
        raised_after_m=max(0.0, later[-1] - until_rest[-1]),
        rest_ns=rest_ns,
        at_rest=is_at_rest(rows, now_ns=now_ns),
        end_z_m=later[-1],
    )


def is_at_rest(rows: Sequence[TraceRow], *, now_ns: int) -> bool:
    """Return whether the arm has been standing still for a while at ``now_ns``."""
    moving = [row.stamp_ns for row in rows if _speed(row) > STILL_M_S]
    return not moving or now_ns - moving[-1] >= REST_NS


def _first_rest_ns(
    start: TraceRow, after: Sequence[TraceRow], stamp_ns: int, now_ns: int
) -> int | None:
    """Return from when on the arm stood still for ``REST_NS`` first."""
    still_since_ns = None if _speed(start) > STILL_M_S else stamp_ns
    for row in after:
        moves = _speed(row) > STILL_M_S
        if still_since_ns is not None and row.stamp_ns - still_since_ns >= REST_NS:
            return still_since_ns
        if moves:
            still_since_ns = None
        elif still_since_ns is None:
            still_since_ns = row.stamp_ns
    if still_since_ns is not None and now_ns - still_since_ns >= REST_NS:
        return still_since_ns
    return None


def true_forces(
    plant: Plant, rows: Sequence[TraceRow], *, rotation: Vector3, start_ns: int, end_ns: int
) -> list[tuple[int, float]]:
    """Press the emulated gel again as the arm did; return (stamp [ns], force [N]), rising.

    Args:
        plant: A fresh gel: it remembers what it was asked.
        rows: The arm's trace.
        rotation: Rotation vector of the tool [rad], the same throughout.
        start_ns: A moment without contact, from which the gel is at rest.
        end_ns: Where to end.
    """
    forces: list[tuple[int, float]] = []
    index = 0
    for stamp_ns in range(start_ns, end_ns, FORCE_STEP_NS):
        while index + 1 < len(rows) and rows[index + 1].stamp_ns <= stamp_ns:
            index += 1
        pose = Pose(position=rows[index].position, rotation_vector=rotation)
        forces.append((stamp_ns, plant.wrench(pose, stamp_ns)[0][2]))
    return forces


def force_rise(
    forces: Sequence[tuple[int, float]], stamp_ns: int, *, until_ns: int
) -> tuple[float, float]:
    """Return (force at a moment, how far it rose above that until ``until_ns``) [N]."""
    before = [force for stamp, force in forces if stamp <= stamp_ns]
    at_moment = before[-1] if before else 0.0
    later = [force for stamp, force in forces if stamp_ns < stamp <= until_ns]
    return at_moment, max(0.0, max(later, default=0.0) - at_moment)


def _speed(row: TraceRow) -> float:
    return math.hypot(*row.velocity)
