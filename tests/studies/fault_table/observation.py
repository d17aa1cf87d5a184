"""What one fault case showed: the arm, the messages that were kept, and what must not be."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from drivers.emulators.faults import SILENT_FORCE_FAULTS, FaultKind
from tacauchy_rig.core.errors import RigError
from tacauchy_rig.core.run import JournalEvent
from tacauchy_rig.core.store.layout import RunPaths
from tacauchy_rig.core.store.recovery import open_readable
from tests.studies.fault_table.arm import ArmOutcome
from tests.studies.fault_table.cases import TARGET_N

PRODUCERS = ("control", "camera")

SILENT_FAULTS = SILENT_FORCE_FAULTS | {
    FaultKind.FREEZE_IMAGE,
    FaultKind.REPEAT_IMAGE,
    FaultKind.WRONG_POSE,
    FaultKind.CLOCK_JUMP,
}
"""What passes for a measurement."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KeptMessages:
    """Messages of one session, by the process that produced them.

    Attributes:
        acknowledged: Messages that the recorder acknowledged.
        readable: Different messages that can be read, spills included.
        force_gap_count: Package numbers missing between the first and the last force sample.
        frame_gap_count: Frame numbers missing between the first and the last frame.
        unreadable: Files that cannot be read at all, and why.
    """

    acknowledged: dict[str, int]
    readable: dict[str, int]
    force_gap_count: int
    frame_gap_count: int
    unreadable: tuple[str, ...] = ()

    @property
    def lost_count(self) -> int:
        """Messages that were acknowledged and cannot be read."""
        return sum(
            max(0, count - self.readable.get(name, 0)) for name, count in self.acknowledged.items()
        )


def acknowledged_messages(events: Iterable[JournalEvent]) -> dict[str, int]:
    """Return how many messages of each producer the recorder acknowledged in one session.

    The recorder tells it at its end, the supervisor at the run's end; a fault may silence one of
    them, and the larger number counts.
    """
    counts = dict.fromkeys(PRODUCERS, 0)
    for event in events:
        if event.name in ("record-end", "run-end"):
            for name, count in event.detail.get("acknowledged", {}).items():
                counts[name] = max(counts.get(name, 0), int(count))
    return counts


def kept_messages(
    paths: RunPaths, attempts: Sequence[tuple[int, int]], acknowledged: dict[str, int]
) -> KeptMessages:
    """Read everything that a session has left of its attempts."""
    control = camera = force_gaps = frame_gaps = 0
    unreadable: list[str] = []
    for trial, attempt in attempts:
        files = [paths.recording(trial, attempt), *paths.spills(trial, attempt)]
        recordings = open_readable([path for path in files if path.exists()], unreadable)
        force = {int(n) for recording in recordings for n in recording.force().counter}
        frames = {int(n) for recording in recordings for n in recording.frame_stamps()[1]}
        states = {int(n) for recording in recordings for n in recording.arm().stamp_ns}
        events = {(e.stamp_ns, e.name) for recording in recordings for e in recording.events()}
        control += len(force) + len(states) + len(events)
        camera += len(frames)
        force_gaps += _gaps(force)
        frame_gaps += _gaps(frames)
    return KeptMessages(
        acknowledged=acknowledged,
        readable={"control": control, "camera": camera},
        force_gap_count=force_gaps,
        frame_gap_count=frame_gaps,
        unreadable=tuple(unreadable),
    )


def _gaps(counters: set[int]) -> int:
    return max(counters) - min(counters) + 1 - len(counters) if counters else 0


LOWERED_LIMIT_M = 1e-6
# No fault may let the gel feel more than this share of the target and so much above it: a force
# that a gel made for the target bears.
MOST_OF_TARGET, MOST_ABOVE_N = 1.5, 0.5
KILLED_EXIT_CODE = -9
# Faults of the force sensor or camera that lose samples before they reach the program.
WIRE_LOSSES = ("force_sensor:drop", "force_sensor:garble", "camera:drop", "camera:garble")


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandEnd:
    """How another command ended: a try to finish the session, or a run that came between.

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
        force_target_n: What the press was to reach [N].
        exit_code: Of the run; negative is the signal that killed it.
        ended_after_s: From the fault until every process of the run was gone [s].
        hung: Processes that had to be ended.
        told: What the operator read last.
        measured: What the run measured of its streams, if it went on.
        rivals: Runs on the same devices that were begun meanwhile.
        made_on: Computer, and how many cases it ran at once.
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
    resumed: tuple[CommandEnd, ...]
    rivals: tuple[CommandEnd, ...] = ()
    force_target_n: float = TARGET_N
    made_on: str = ""

    @property
    def force_most_n(self) -> float:
        """Largest true force from the fault on [N]."""
        return self.force_at_fault_n + self.force_rise_n

    @property
    def lies(self) -> bool:
        """True where a device said what was not so."""
        return self.cause.partition(":")[2] in SILENT_FAULTS

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
        """What must not be: motion, a hang, a loss, silence, too much force, a lie that passes."""
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
    yield from _force_problems(seen)
    if seen.exit_code not in (0, 1, RigError.exit_code, 3, KILLED_EXIT_CODE):
        yield f"exit status {seen.exit_code}"
    if not seen.resumed or seen.resumed[-1].exit_code != 0:
        yield "resume did not finish the session"


def _force_problems(seen: Observation) -> Iterator[str]:
    most_n = MOST_OF_TARGET * seen.force_target_n + MOST_ABOVE_N
    if seen.force_most_n > most_n:
        yield f"the gel felt {seen.force_most_n:.2f} N; at most {most_n:.2f} N is allowed"
    if seen.lies and seen.exit_code == 0:
        yield "the run passed"
    if any(rival.exit_code in (0, 1) for rival in seen.rivals):
        yield "a second run pressed with the same devices"


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
