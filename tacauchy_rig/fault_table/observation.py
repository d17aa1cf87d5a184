"""What one fault case showed, and what of it must not be."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from tacauchy_rig.errors import RigError
from tacauchy_rig.fault_table.arm import ArmOutcome
from tacauchy_rig.fault_table.record import KeptMessages

LOWERED_LIMIT_M = 1e-6
KILLED_EXIT_CODE = -9
# Faults of the force sensor or camera that lose samples before they reach the program.
WIRE_LOSSES = ("force_sensor:drop", "force_sensor:garble", "camera:drop", "camera:garble")


@dataclass(frozen=True, slots=True, kw_only=True)
class Resumed:
    """One try to finish the session.

    Attributes:
        told: What the operator was told, if it did not succeed.
    """

    exit_code: int
    told: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """One fault case, measured.

    Attributes:
        name: Of the case.
        tries: Runs that were needed to reach the moment.
        force_at_fault_n: True force at the moment [N].
        force_rise_n: Most that the true force rose after it [N].
        exit_code: Of the run; negative is the signal that killed it.
        ended_after_s: From the fault until every process of the run was gone [s].
        hung: Processes that had to be ended.
        told: What the operator read last.
        measured: What the run measured of its streams, if it went on.
        kept_after_resume: The same messages, read again when the session was finished.
    """

    name: str
    tries: int
    arm: ArmOutcome
    force_at_fault_n: float
    force_rise_n: float
    exit_code: int
    ended_after_s: float
    hung: tuple[str, ...]
    told: str
    measured: dict[str, float]
    kept: KeptMessages
    kept_after_resume: KeptMessages
    resumed: tuple[Resumed, ...]

    @property
    def cause(self) -> str:
        """What went wrong, without the moment."""
        return self.name.partition("@")[0]

    @property
    def went_on(self) -> bool:
        """True when the run judged its trial as if nothing had happened."""
        return self.exit_code in (0, 1)

    @property
    def problems(self) -> tuple[str, ...]:
        """What must not be: motion, a hang, a lost sample, silence, a session left unfinished."""
        return tuple(_problems(self))


def _problems(seen: Observation) -> Iterator[str]:
    if seen.hung:
        yield f"had to be ended: {', '.join(seen.hung)}"
    if not seen.arm.at_rest:
        yield "the arm still moves"
    elif not seen.went_on and seen.arm.stopped_after_s is None:
        yield "the arm never stood still"
    if not seen.went_on and seen.arm.lowered_after_m > LOWERED_LIMIT_M:
        yield f"went down again by {seen.arm.lowered_after_m * 1e3:.3f} mm after it had stopped"
    yield from _record_problems(seen)
    if not seen.told and seen.exit_code not in (0, KILLED_EXIT_CODE):
        yield "the operator was told nothing"
    if seen.exit_code not in (0, 1, RigError.exit_code, 3, KILLED_EXIT_CODE):
        yield f"exit status {seen.exit_code}"
    if not seen.resumed or seen.resumed[-1].exit_code != 0:
        yield "resume did not finish the session"


def _record_problems(seen: Observation) -> Iterator[str]:
    for when, kept in (("", seen.kept), (" after resume", seen.kept_after_resume)):
        if kept.lost_count:
            yield f"{kept.lost_count} acknowledged messages cannot be read{when}"
        yield from kept.unreadable
    if sum(seen.kept_after_resume.readable.values()) < sum(seen.kept.readable.values()):
        yield "recovery lost messages"
    gaps = seen.kept.force_gap_count + seen.kept.frame_gap_count
    if gaps and seen.cause not in WIRE_LOSSES:
        yield f"{gaps} samples are missing in the middle of the record"
