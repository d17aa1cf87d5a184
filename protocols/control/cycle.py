"""One turn of the control loop: look at every device, record, guard, feed the watchdog.

Whatever a step waits for, it waits by turning this cycle, so nothing ever waits unguarded.
"""

from collections.abc import Callable
from dataclasses import dataclass

from drivers.interfaces import ProgramEndedError, Rig
from protocols.control.record_entries_and_rates import RateMeter, Sink
from protocols.guard.abort import Abort
from protocols.guard.breach_reaction import BreachError, Reaction, most_severe
from protocols.guard.force_limits import ForceGuard
from protocols.guard.force_witness_and_band import Witness
from protocols.guard.place_and_motion import FollowGuard, Workspace
from protocols.guard.stale_streams import StreamGuard
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.errors import AbortedError, DeviceError
from tacauchy_rig.core.run import ArmSample, ExpectedPress, ForceSample, Pose, Vector6

PERIOD_S = 0.005
KICK_PERIOD_NS = 25_000_000


@dataclass(frozen=True, slots=True)
class Press:
    """One guarded force sample."""

    stamp_ns: int
    force_n: float  # pressing force [N], tared, positive in compression; 0 before the first tare
    sideways_n: float  # sideways force [N], tared
    raw: ForceSample  # the sample as it came


@dataclass(frozen=True, slots=True)
class Reading:
    """What one turn found: new force samples, oldest first, and the arm's newest state."""

    presses: tuple[Press, ...]
    arm: ArmSample
    now_ns: int


class Cycle:
    """The control loop's body."""

    def __init__(
        self,
        rig: Rig,
        config: RigConfig,
        *,
        sink: Sink,
        abort: Abort,
        expected: ExpectedPress | None = None,
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
        self.last_state: ArmSample | None = None
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
        states: list[ArmSample] = []
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

    def set_velocity(self, velocity: Vector6) -> None:
        """Set the tool's velocity [m/s, rad/s]."""
        with _AsBreach("robot"):
            self.rig.arm.set_velocity(velocity, acceleration=self.config.robot.acceleration)
        self._follow.command(velocity[2])

    def start_move(self, target: Pose, *, speed: float) -> None:
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
        self.rates.turn(turn_s)
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

    def _read_arm(self, states: list[ArmSample]) -> None:
        with _AsBreach("robot"):
            states += self.rig.arm.drain()
            if states:
                self.sink.put(tuple(states))
            self.last_state = state = self.rig.arm.state()
        self.rates.arm(len(states))
        self.workspace.check_state(state)
        self._follow.check(state.pose.position[2], now_ns=self.rig.clock.now_ns())

    def _check_witness(self, presses: list[Press], states: list[ArmSample]) -> None:
        if self.last_state is not None:
            forces_n, z_m = [press.force_n for press in presses], self.last_state.pose.position[2]
            self.witness.check(forces_n, states, z_m=z_m, seen=self._touch_seen)

    def _watch_record(self) -> None:
        self.rates.record_lag(self.sink.lag_s())
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
