"""One turn of the control loop: look at every device, record, guard, feed the watchdog.

Whatever a step waits for, it waits by turning this cycle, so nothing ever waits unguarded. What it
hands over to be kept goes entry by entry.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from drivers.interfaces import Clock, FrameMark, ProgramEndedError, Rig, StreamHealth
from protocols.guard.abort import Abort
from protocols.guard.breach_reaction import BreachError, Reaction, most_severe
from protocols.guard.force_limits import ForceGuard
from protocols.guard.force_witness_and_band import Witness
from protocols.guard.place_and_motion import FollowGuard, Workspace
from protocols.guard.stale_streams import StreamGuard
from tacauchy_rig.core import run
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.errors import AbortedError, DeviceError


@dataclass(frozen=True, slots=True)
class Begin:
    """An attempt begins."""

    trial: int
    attempt: int


@dataclass(frozen=True, slots=True)
class End:
    """An attempt ended; frames up to ``stamp_ns`` belong to it."""

    record: run.TrialRecord
    stamp_ns: int


Samples = tuple[run.ForceSample | run.ArmSample | run.ImageFrame, ...]
Entry = Begin | Samples | run.JournalEvent | End
"""What a producer records; samples of one entry are of one kind."""


class Sink(Protocol):
    """Takes the record of a run, in order; it never blocks, raises or loses in silence."""

    def put(self, entry: Entry) -> None:
        """Take an entry."""

    def problem(self) -> str:
        """Return why nothing more can be kept, or an empty text."""

    def lag_s(self) -> float:
        """Return for how long the oldest entry has been on its way to the disk [s]."""


PROGRESS = "progress"
"""Name of events that are shown and not kept."""


class Journal:
    """Writes events of the attempt that runs now; between trials its number is 0."""

    def __init__(
        self, sink: Sink, clock: Clock, *, listener: Callable[[run.JournalEvent], object]
    ) -> None:
        self.trial = 0
        self.attempt = 0
        self.phase = run.Phase.PREFLIGHT
        self._sink = sink
        self._clock = clock
        self._listener = listener

    def enter(self, phase: run.Phase, **detail: Any) -> None:
        """Note that a phase begins; units in the names of ``detail``."""
        self.phase = phase
        self.write("phase", phase=phase.value, **detail)

    def write(self, name: str, **detail: Any) -> None:
        """Keep and show an event."""
        event = self._event(name, detail)
        self._sink.put(event)
        self._listener(event)

    def show(self, **detail: Any) -> None:
        """Show progress without keeping it."""
        self._listener(self._event(PROGRESS, {"phase": self.phase.value, **detail}))

    def _event(self, name: str, detail: dict[str, Any]) -> run.JournalEvent:
        return run.JournalEvent(
            stamp_ns=self._clock.now_ns(),
            name=name,
            trial=self.trial,
            attempt=self.attempt,
            detail=detail,
        )


class RateMeter:
    """Counts what arrives; ``report`` says how well.

    Attributes:
        arm_count: States of the arm.
        turns_s: How long each turn of the control loop took [s].
        record_lag_s: How far the disk was behind at most [s].
    """

    def __init__(self) -> None:
        self.arm_count, self.record_lag_s = 0, 0.0
        self.turns_s: list[float] = []
        self._force: list[run.ForceSample] = []
        self._frames: list[FrameMark] = []
        self._frames_lost: list[int] = []
        self._clipped_ratio = self._force_lag_s = 0.0

    def force(self, samples: Sequence[run.ForceSample], *, lag_s: float) -> None:
        """Count force samples that arrived ``lag_s`` [s] late, against the undelayed stream."""
        self._force += samples
        self._force_lag_s = max(self._force_lag_s, lag_s)

    def frames(self, marks: Sequence[FrameMark], health: StreamHealth) -> None:
        """Count camera frames, and those that the driver dropped; note what was at full scale."""
        self._frames += marks
        self._frames_lost[1:] = [health.lost_count]  # the first and the last
        self._clipped_ratio = max(self._clipped_ratio, health.clipped_ratio)

    def frame_count(self, start_ns: int, end_ns: int) -> int:
        """Return how many frames arrived within a window."""
        return sum(start_ns <= mark.stamp_ns <= end_ns for mark in self._frames)

    def repeated_frame_count(self, before: tuple[int, int], window: tuple[int, int]) -> int:
        """Return how many frames of a window are, byte by byte, another of it or one of before.

        Windows are the first and the last stamp [ns].
        """
        start_ns, end_ns = before
        known = {mark.digest for mark in self._frames if start_ns <= mark.stamp_ns <= end_ns}
        start_ns, end_ns = window
        shown = [mark.digest for mark in self._frames if start_ns <= mark.stamp_ns <= end_ns]
        often = Counter(shown)
        return sum(digest in known or often[digest] > 1 for digest in shown)

    def report(self) -> dict[str, float]:
        """Return the numbers of ``TrialRecord.rates``; units are in the keys."""
        turns_ms = np.array(self.turns_s or [0.0]) * 1e3
        span_s = float(np.sum(turns_ms)) * 1e-3
        dropped = self._frames_lost or [0]
        return {
            **_stream("force", self._force),
            **_stream("image", self._frames, dropped_count=dropped[-1] - dropped[0]),
            "image_clipped_ratio": self._clipped_ratio,
            "arm_rate_hz": self.arm_count / span_s if span_s > 0.0 else 0.0,
            "force_lag_max_ms": self._force_lag_s * 1e3,
            "record_lag_max_ms": self.record_lag_s * 1e3,
            "control_loop_ms_p50": float(np.percentile(turns_ms, 50)),
            "control_loop_ms_p99": float(np.percentile(turns_ms, 99)),
            "control_loop_ms_max": float(np.max(turns_ms)),
        }


def lateness_ms(stamps_ns: Sequence[int], counters: Sequence[int]) -> FloatArray:
    """Return how much later than the promptest each sample arrived, shape [n] [ms].

    The device's clock is the straight line through stamps over counters; what all samples share
    (exposure, transfer) cannot be seen from here and is not in these numbers.
    """
    if len(stamps_ns) < 2:
        return np.zeros(len(stamps_ns))
    elapsed_ms = (np.array(stamps_ns, dtype=np.int64) - stamps_ns[0]) * 1e-6
    counted = np.array(counters, dtype=np.float64) - counters[0]
    clock = np.polynomial.Polynomial.fit(counted, elapsed_ms, 1)
    late = elapsed_ms - clock(counted)
    return np.asarray(late - late.min())


def _stream(
    name: str, arrived: Sequence[run.ForceSample | FrameMark], *, dropped_count: int = 0
) -> dict[str, float]:
    stamps_ns = [one.stamp_ns for one in arrived]
    counters = [one.counter for one in arrived]
    missing_count = counters[-1] - counters[0] + 1 - len(counters) if counters else 0
    late_ms = lateness_ms(stamps_ns, counters)
    late_ms = late_ms if len(late_ms) else np.zeros(1)
    gaps_ms = np.diff(np.array(stamps_ns, dtype=np.int64)) * 1e-6
    span_s = float(np.sum(gaps_ms)) * 1e-3
    return {
        f"{name}_count": float(len(stamps_ns)),
        f"{name}_rate_hz": len(gaps_ms) / span_s if span_s > 0.0 else 0.0,
        f"{name}_gap_max_ms": float(np.max(gaps_ms)) if len(gaps_ms) else 0.0,
        f"{name}_latency_ms_p50": float(np.percentile(late_ms, 50)),
        f"{name}_latency_ms_p99": float(np.percentile(late_ms, 99)),
        f"{name}_latency_ms_max": float(np.max(late_ms)),
        f"{name}_lost_count": float(missing_count + dropped_count),
    }


PERIOD_S = 0.005
KICK_PERIOD_NS = 25_000_000


@dataclass(frozen=True, slots=True)
class Press:
    """One guarded force sample."""

    stamp_ns: int
    force_n: float  # pressing force [N], tared, positive in compression; 0 before the first tare
    sideways_n: float  # sideways force [N], tared
    raw: run.ForceSample  # the sample as it came


@dataclass(frozen=True, slots=True)
class Reading:
    """What one turn found: new force samples, oldest first, and the arm's newest state."""

    presses: tuple[Press, ...]
    arm: run.ArmSample
    now_ns: int


def turns(turn: Callable[[], Reading], limit_s: float) -> Iterator[Reading]:
    """Yield what turn after turn brings, at least one, until ``limit_s`` [s] are over."""
    reading = turn()
    deadline_ns = reading.now_ns + round(limit_s * 1e9)
    while reading.now_ns <= deadline_ns:
        yield reading
        reading = turn()


class Cycle:
    """The control loop's body."""

    def __init__(
        self,
        rig: Rig,
        config: RigConfig,
        *,
        sink: Sink,
        abort: Abort,
        expected: run.ExpectedPress | None = None,
    ) -> None:
        self.rig = rig
        self.config = config
        self.sink = sink
        self.abort = abort
        self.force_guard = ForceGuard(config)
        self.witness = Witness(config, expected)  # what else knows of the force
        self.workspace = Workspace(config)
        self.rates = RateMeter()  # what arrived since the attempt began
        self.last_force_n = 0.0
        self.last_state: run.ArmSample | None = None
        # Height of contact of the last trial [m]; before the first of a session the lowest of those
        # that passed in earlier ones; None where there was none.
        self.contact_z_m: float | None = None
        # Each is called at every turn, whatever the turn finds, and must not block.
        self.observers: list[Callable[[], None]] = []
        self._streams = StreamGuard(config)
        self._follow = FollowGuard(window_s=config.limits.no_motion)
        self._touch_seen = False
        self._aborts_heeded = 0
        self._turned_ns: int | None = None
        self._kicked_ns = 0

    def turn(self) -> Reading:
        """Wait for the next turn and do it.

        Raises:
            BreachError: A limit was passed, or a device or the record is gone.
            AbortedError: A person asked to stop.
        """
        self._streams.note_turn(self._pace())
        for observer in self.observers:
            observer()
        if self.abort.count > self._aborts_heeded:
            self._aborts_heeded = self.abort.count
            raise AbortedError(f"aborted: {self.abort.reason}")
        presses: list[Press] = []
        states: list[run.ArmSample] = []
        breaches: list[BreachError] = []
        # All parts run whatever one of them finds: a dead camera must not hide a rising force.
        for part in (
            self._kick,
            lambda: self._read_force(presses),
            lambda: self._read_arm(states),
            self._watch_camera,
            self._watch_record,
            lambda: self._check_witness(presses, states),
        ):
            try:
                part()
            except BreachError as breach:
                breaches.append(breach)
        if breaches:
            raise self._explained(most_severe(breaches))
        if self.last_state is None:
            raise BreachError(
                "robot: it has reported no state", limit="robot", reaction=Reaction.HOLD, remedy=""
            )
        return Reading(presses=tuple(presses), arm=self.last_state, now_ns=self.rig.clock.now_ns())

    def set_velocity(self, velocity: run.Vector6) -> None:
        """Set the tool's velocity [m/s, rad/s]."""
        with _AsBreach("robot"):
            self.rig.arm.set_velocity(velocity, acceleration=self.config.robot.acceleration)
        self._follow.command(velocity[2])

    def start_move(self, target: run.Pose, *, speed: float) -> None:
        """Start a straight move after every check that can be made beforehand."""
        self.workspace.check_target(target)
        self._follow.forget()
        with _AsBreach("robot"):
            if not self.rig.arm.is_pose_allowed(target):
                raise DeviceError(
                    f"robot: its safety limits do not admit {target.position}",
                    remedy="see the safety planes in the controller's installation",
                )
            self.rig.arm.start_move(
                target, speed=speed, acceleration=self.config.robot.acceleration
            )

    def is_moving(self) -> bool:
        """Return whether the move that was started last goes on."""
        with _AsBreach("robot"):
            return self.rig.arm.is_moving()

    def stop(self) -> None:
        """End any motion; never raises."""
        self._follow.forget()
        self.rig.arm.stop()

    def _explained(self, breach: BreachError) -> BreachError:
        """Return what stopped an arm that was not fed in time: this computer, not the robot."""
        held_up_s, fed_s = self._streams.held_up_s, 1.0 / self.config.robot.watchdog
        if not isinstance(breach.__cause__, ProgramEndedError) or held_up_s < fed_s:
            return breach
        return BreachError(
            f"this computer was too busy: the control loop was held up for {held_up_s * 1e3:.0f} "
            f"ms, and the robot's watchdog stops the arm after {fed_s * 1e3:.0f} ms "
            f"({breach.message})",
            limit=breach.limit,
            reaction=breach.reaction,
            remedy="end other programs, then `tacauchy-rig resume` continues with this trial",
        )

    def _pace(self) -> float:
        clock = self.rig.clock
        if self._turned_ns is not None:
            due_ns = self._turned_ns + round(PERIOD_S * 1e9)
            clock.sleep((due_ns - clock.now_ns()) * 1e-9)
        now_ns = clock.now_ns()
        turn_s = PERIOD_S if self._turned_ns is None else (now_ns - self._turned_ns) * 1e-9
        self._turned_ns = now_ns
        self.rates.turns_s.append(turn_s)
        return turn_s

    def _kick(self) -> None:
        now_ns = self.rig.clock.now_ns()
        if now_ns - self._kicked_ns >= KICK_PERIOD_NS:
            self._kicked_ns = now_ns
            with _AsBreach("robot"):
                self.rig.arm.kick_watchdog()

    def _read_force(self, presses: list[Press]) -> None:
        sensor = self.rig.force_sensor
        with _AsBreach("force sensor"):
            samples = sensor.drain()
            health = sensor.health()
            if samples:
                self._streams.note_force(samples[-1])
                self.rates.force(samples, lag_s=self._streams.force_lag_s)
                self.sink.put(tuple(samples))
        for sample in samples:
            force_n = self.force_guard.check(sample)
            presses.append(Press(sample.stamp_ns, force_n, self.force_guard.sideways_n, sample))
            self.last_force_n = force_n
        self._streams.check_force(health, now_ns=self.rig.clock.now_ns())

    def _read_arm(self, states: list[run.ArmSample]) -> None:
        with _AsBreach("robot"):
            states += self.rig.arm.drain()
            if states:
                self.sink.put(tuple(states))
            self.last_state = state = self.rig.arm.state()
        self.rates.arm_count += len(states)
        self.workspace.check_state(state)
        self._follow.check(state.pose.position[2], now_ns=self.rig.clock.now_ns())

    def _check_witness(self, presses: list[Press], states: list[run.ArmSample]) -> None:
        if self.last_state is not None:
            forces_n, z_m = [press.force_n for press in presses], self.last_state.pose.position[2]
            self.witness.check(forces_n, states, z_m=z_m, seen=self._touch_seen)

    def _watch_record(self) -> None:
        self.rates.record_lag_s = max(self.rates.record_lag_s, self.sink.lag_s())
        if problem := self.sink.problem():
            raise BreachError(
                problem,
                limit="recorder",
                reaction=Reaction.RETRACT,
                remedy="check the disk, then `tacauchy-rig resume` continues with this trial",
            )

    def _watch_camera(self) -> None:
        with _AsBreach("camera", Reaction.RETRACT):
            marks, health = self.rig.camera.poll(), self.rig.camera.health()
        if marks:
            self._touch_seen = marks[-1].touched
        self.rates.frames(marks, health)
        self._streams.check_image(health)


@dataclass(slots=True)
class _AsBreach:
    """Makes the loss of a device a breach; no generator, as every turn enters it."""

    device: str
    reaction: Reaction = Reaction.HOLD

    def __enter__(self) -> None: ...

    def __exit__(self, _kind: object, error: BaseException | None, _trace: object) -> None:
        if isinstance(error, DeviceError):
            raise BreachError(
                error.message, limit=self.device, reaction=self.reaction, remedy=error.remedy
            ) from error
