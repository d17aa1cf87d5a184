"""What one fault case showed: the arm, the messages that were kept, and what must not be."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from drivers.emulators.faults import SILENT_FORCE_FAULTS, FaultKind
from drivers.emulators.plant.gel_response import Plant
from tacauchy_rig.core.errors import RecordError, RigError
from tacauchy_rig.core.run import JournalEvent, Pose, Vector3
from tacauchy_rig.core.store.recording.mcap_reader import Recording
from tacauchy_rig.core.store.run_files import RunPaths
from tests.drivers.arm_notes import TraceRow
from tests.studies.fault_table.cases import TARGET_N

STILL_M_S = 1e-7
REST_NS = 100_000_000  # standing still for so long counts as a stop
FORCE_STEP_NS = 4_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmOutcome:
    """How the arm behaved from a moment on."""

    speed_before_m_s: float  # speed at the moment
    stopped_after_s: float | None  # until it stood still; None when it never did
    descended_m: float  # how far down it went before it stood still, at most
    lowered_after_m: float  # how far down it went after it had stood still, at most
    raised_after_m: float  # how far up it was in the end above where it stood still
    rest_ns: int | None  # when it stood still first; None when it never did
    at_rest: bool  # whether it stood still in the end
    end_z_m: float  # height of the tip in the end


def arm_after(rows: Sequence[TraceRow], stamp_ns: int, *, now_ns: int) -> ArmOutcome:
    """Return what the arm did after ``stamp_ns``, as far as its trace goes at ``now_ns``."""
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
    """Press the emulated gel again as the arm did; return (stamp [ns], force [N]), rising."""
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
    """Messages of one session, by the process that produced them."""

    acknowledged: dict[str, int]  # messages that the recorder acknowledged
    readable: dict[str, int]  # different messages that can be read, spills included
    force_gap_count: int  # package numbers missing between the first and the last force sample
    frame_gap_count: int  # frame numbers missing between the first and the last frame
    unreadable: tuple[str, ...] = ()  # files that cannot be read at all, and why

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
        recordings = _open_readable([path for path in files if path.exists()], unreadable)
        force = {int(n) for recording in recordings for n in recording.force.counter}
        frames = {int(n) for recording in recordings for n in recording.frame_stamps()[1]}
        states = {int(n) for recording in recordings for n in recording.arm.stamp_ns}
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


def _open_readable(paths: Sequence[Path], unreadable: list[str]) -> list[Recording]:
    recordings = []
    for path in paths:
        try:
            recordings.append(Recording.open(path))
        except RecordError as error:
            unreadable.append(str(error))
    return recordings


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
    """How another command ended: a try to finish the session, or a run that came between."""

    exit_code: int
    told: str  # what the operator was told, if it did not succeed


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """One fault case, measured."""

    name: str  # of the case
    tries: int  # runs that were needed to reach the moment
    arm: ArmOutcome
    force_at_fault_n: float  # true force at the moment [N]
    force_rise_n: float  # most that the true force rose after it [N]
    exit_code: int  # of the run; negative is the signal that killed it
    ended_after_s: float  # from the fault until every process of the run was gone [s]
    hung: tuple[str, ...]  # processes that had to be ended
    told: str  # what the operator read last
    measured: dict[str, float]  # what the run measured of its streams, if it went on
    kept: KeptMessages
    kept_after_resume: KeptMessages  # the same messages, read again when the session was finished
    resumed: tuple[CommandEnd, ...]
    rivals: tuple[CommandEnd, ...] = ()  # runs on the same devices that were begun meanwhile
    force_target_n: float = TARGET_N  # what the press was to reach [N]
    made_on: str = ""  # computer, and how many cases it ran at once

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
