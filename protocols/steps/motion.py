"""Standing still, straight moves, and making the arm safe; watched at every turn.

Raw force stays raw: statistics and zeros of it are made here.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivers.force_sensor.weighing import tare_of
from protocols.control.cycle import Cycle, Press
from protocols.control.record import Journal
from protocols.guard.breach import BreachError, Reaction, reaction_to
from protocols.guard.force import Contact
from protocols.guard.workspace import describe
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.errors import AbortedError, DeviceError, RigError
from tacauchy_rig.core.run import FZ, ArmSample, Criterion, Phase, Pose, Tare, Vector6


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceWindow:
    """Statistics of the pressing force over a window; the slope is that of least squares."""

    start_ns: int
    end_ns: int
    mean_n: float
    deviation_n: float
    slope_n_s: float


def summarise(presses: Sequence[Press]) -> ForceWindow:
    """Return the statistics of at least two samples."""
    force = np.array([press.force_n for press in presses])
    stamps = np.array([press.stamp_ns - presses[0].stamp_ns for press in presses]) * 1e-9
    centred = stamps - stamps.mean()
    spread = float(centred @ centred)
    return ForceWindow(
        start_ns=presses[0].stamp_ns,
        end_ns=presses[-1].stamp_ns,
        mean_n=float(force.mean()),
        deviation_n=float(force.std(ddof=1)),
        slope_n_s=float(centred @ force) / spread if spread > 0.0 else 0.0,
    )


def listen(cycle: Cycle, duration_s: float) -> list[Press]:
    """Stand still for ``duration_s`` [s] and return what was felt.

    The last turn begins when it is over: what came while the computer was held up is not lost.
    """
    clock = cycle.rig.clock
    end_ns = clock.now_ns() + round(duration_s * 1e9)
    presses: list[Press] = []
    is_over = False
    while not is_over:
        is_over = clock.now_ns() >= end_ns
        presses += cycle.turn().presses
    return presses


TRIES = 3
MIN_SHARE = 0.5


def take_tare(cycle: Cycle) -> Tare:
    """Average the raw wrench over ``protocol.tare_duration``, standing still.

    Raises:
        BreachError: Fewer than half of the expected samples came.
    """
    duration_s = cycle.config.protocol.tare_duration
    samples = [press.raw for press in listen(cycle, duration_s)]
    expected = duration_s * cycle.config.force_sensor.rate
    if len(samples) < max(2.0, MIN_SHARE * expected):
        raise BreachError(
            f"force sensor: {len(samples)} samples in {duration_s:g} s of tare, "
            f"{expected:.0f} were expected",
            limit="protocol.tare_duration",
            reaction=Reaction.HOLD,
            remedy="check force_sensor.rate against what the box sends",
        )
    return tare_of(samples)


def take_quiet_tare(cycle: Cycle) -> Tare:
    """Take tares until one passes the gate, at most ``TRIES``; return the last one."""
    tare = take_tare(cycle)
    for _ in range(TRIES - 1):
        if all(criterion.passed for criterion in judge_tare(tare, cycle.config)):
            break
        tare = take_tare(cycle)
    return tare


def judge_tare(tare: Tare, config: RigConfig) -> tuple[Criterion, ...]:
    """Compare mean and deviation of an unloaded interval with their gates."""
    protocol = config.protocol
    return (
        Criterion.at_most(
            "tare_deviation",
            max(tare.deviation[:3]),
            protocol.tare_deviation,
            unit="N",
            remedy="let the table come to rest; look for fans and loose cables",
        ),
        Criterion.at_most(
            "tare_mean",
            max(map(abs, tare.mean[:3])),
            protocol.tare_mean,
            unit="N",
            remedy="see what hangs on the sensor; zero the box",
        ),
    )


def force_drift(before: Tare, after: Tare, *, config: RigConfig) -> float:
    """Return the unloaded pressing force after minus before [N]."""
    return config.force_sensor.compression_sign * (after.mean[FZ] - before.mean[FZ])


logger = logging.getLogger(__name__)

ARRIVED_M = 0.0005
REST_SPEED_M_S = 2e-5
REST_TIMEOUT_S = 0.5
SPARE_S = 3.0


def move_to(cycle: Cycle, target: Pose, *, speed: float) -> None:
    """Move in a straight line [m/s] and return on arrival."""
    start = cycle.turn().arm.pose
    distance = math.dist(start.position, target.position)
    deadline_ns = cycle.rig.clock.now_ns() + round((1.5 * distance / speed + SPARE_S) * 1e9)
    cycle.start_move(target, speed=speed)
    reading = cycle.turn()
    while cycle.is_moving():
        if reading.now_ns > deadline_ns:
            cycle.stop()
            raise _not_arrived(target, reading.arm.pose, "in time")
        reading = cycle.turn()
    reading = cycle.turn()
    if math.dist(reading.arm.pose.position, target.position) > ARRIVED_M:
        raise _not_arrived(target, reading.arm.pose, "there")


def come_to_rest(cycle: Cycle) -> None:
    """Stop and turn until the arm stands still, at most ``REST_TIMEOUT_S``."""
    cycle.stop()
    deadline_ns = cycle.rig.clock.now_ns() + round(REST_TIMEOUT_S * 1e9)
    reading = cycle.turn()
    while reading.now_ns < deadline_ns:
        if _is_at_rest(reading.arm):
            return
        reading = cycle.turn()


def downward(speed: float) -> Vector6:
    """Return the tool velocity for ``speed`` [m/s] towards the gel; negative is away."""
    return (0.0, 0.0, -speed, 0.0, 0.0, 0.0)


def at_height(cycle: Cycle, z_m: float) -> Pose:
    """Return the pose above the middle of the gel at height ``z_m`` [m], tool straight down."""
    x, y, _ = cycle.config.sensor.surface
    return Pose(position=(x, y, z_m), rotation_vector=cycle.config.robot.tool_rotation)


def clear_height(cycle: Cycle) -> float:
    """Return the height above which the tip is clear of the gel [m]."""
    return cycle.config.sensor.surface[2] + cycle.config.protocol.approach_height


def home_pose(cycle: Cycle) -> Pose:
    """Return the pose that every trial starts from."""
    robot = cycle.config.robot
    return Pose(position=robot.home, rotation_vector=robot.tool_rotation)


def _not_arrived(target: Pose, actual: Pose, how: str) -> BreachError:
    return BreachError(
        f"robot: it did not arrive {how}: asked for {describe(target)}, is at {describe(actual)}",
        limit="robot.arrival",
        reaction=Reaction.HOLD,
        remedy="see whether the controller shows a message or runs at reduced speed",
    )


def approach(cycle: Cycle) -> None:
    """Go to ``protocol.approach_height`` above the expected surface."""
    cycle.force_guard.contact = Contact.NONE
    pose = at_height(cycle, clear_height(cycle))
    move_to(cycle, pose, speed=cycle.config.robot.approach_speed)


CLEAR_M = 0.001
"""Above contact by this much the gel has let go, however it sticks."""


def retract(cycle: Cycle, *, contact_z_m: float) -> None:
    """Go straight up off the gel and then home."""
    cycle.force_guard.contact = Contact.LEAVING
    cycle.witness.rest()
    speed = cycle.config.robot.retract_speed
    come_to_rest(cycle)
    move_to(cycle, at_height(cycle, contact_z_m + CLEAR_M), speed=speed)
    # A force sample may be as old as its limit: what it says of the gel is no contact any more.
    listen(cycle, cycle.config.limits.stale_force)
    cycle.force_guard.contact = Contact.NONE
    move_to(cycle, home_pose(cycle), speed=speed)


REST_S = 0.4
SLOW_M_S = 0.002


@dataclass(frozen=True, slots=True, kw_only=True)
class SafeEnd:
    """Where the arm was left, in a sentence for the operator too."""

    text: str
    # From the stop command to the first state at rest [ms]; None where the robot could not be seen
    # to rest.
    stop_ms: float | None
    peak_force_n: float  # largest force from the stop on [N]
    pose: Pose | None  # last pose that was seen


def make_safe(cycle: Cycle, reaction: Reaction) -> SafeEnd:
    """Stop at once, then do what ``reaction`` allows. Raises nothing of its own."""
    if reaction is Reaction.PROTECTIVE_STOP:
        _lock(cycle)
    cycle.stop()
    stop_ns = cycle.rig.clock.now_ns()
    cycle.force_guard.contact = Contact.LEAVING
    cycle.witness.rest()
    stop_ms, peak_n, worst = _watch_rest(cycle, stop_ns)
    if worst is not None and worst.reaction is not reaction:
        if worst.reaction is Reaction.PROTECTIVE_STOP:
            _lock(cycle)
        if reaction is not Reaction.PROTECTIVE_STOP:
            reaction = worst.reaction
    if reaction is Reaction.RETRACT:
        text = _leave_gel(cycle)
    elif reaction is Reaction.PROTECTIVE_STOP:
        text = "The arm is in a protective stop; a person has to unlock it"
    else:
        text = "The arm was told to stop and to hold"
    pose = cycle.last_state.pose if cycle.last_state else None
    where = f"; the tip was last seen at {describe(pose)}" if pose else ""
    return SafeEnd(text=f"{text}{where}.", stop_ms=stop_ms, peak_force_n=peak_n, pose=pose)


def end_safely(cycle: Cycle, journal: Journal, error: RigError, *, of: str = "") -> None:
    """Make the arm safe after ``error``, keep how that went, and tell it in the error's message."""
    reaction, phase, force_n = reaction_to(error), journal.phase, cycle.last_force_n
    journal.phase = Phase.FAULT  # what is shown meanwhile; written once the arm is safe
    end = make_safe(cycle, reaction)
    journal.enter(Phase.FAULT)
    journal.write(
        "abort" if isinstance(error, AbortedError) else "fault",
        limit=error.limit if isinstance(error, BreachError) else "",
        reason=error.message,
        during=phase.value,
        reaction=reaction.value,
        force_n=force_n,
        peak_force_n=end.peak_force_n,
        stop_ms=end.stop_ms,
        position_m=list(end.pose.position) if end.pose else None,
        arm=end.text,
    )
    error.message = f"{error.message} during {phase.value}{of}. {end.text}"


def _lock(cycle: Cycle) -> None:
    try:
        cycle.rig.arm.protective_stop()
    except DeviceError as error:
        logger.error("no protective stop: %s", error)


def _watch_rest(cycle: Cycle, stop_ns: int) -> tuple[float | None, float, BreachError | None]:
    peak_n = abs(cycle.last_force_n)
    rested_ms: float | None = None
    worst: BreachError | None = None
    deadline_ns = stop_ns + round(REST_S * 1e9)
    while cycle.rig.clock.now_ns() < deadline_ns:
        breach = _turn(cycle)
        is_locked = worst is not None and worst.reaction is Reaction.PROTECTIVE_STOP
        if breach is not None and breach.reaction is not Reaction.RETRACT and not is_locked:
            worst = breach
        peak_n = max(peak_n, abs(cycle.last_force_n))
        state = cycle.last_state
        is_new = state is not None and state.stamp_ns > stop_ns
        if rested_ms is None and state is not None and is_new and _is_at_rest(state):
            rested_ms = (state.stamp_ns - stop_ns) * 1e-6
    return rested_ms, peak_n, worst


def _is_at_rest(state: ArmSample) -> bool:
    return math.hypot(*state.velocity[:3]) < REST_SPEED_M_S


def _turn(cycle: Cycle) -> BreachError | None:
    try:
        cycle.turn()
    except BreachError as breach:
        return breach
    except AbortedError:
        pass
    return None


def _leave_gel(cycle: Cycle) -> str:
    state = cycle.last_state
    clear_m = clear_height(cycle)
    if state is None:
        return "The arm stopped"
    height_m = state.pose.position[2]
    if height_m >= clear_m:
        return "The arm stopped clear of the gel"
    speed = min(SLOW_M_S, cycle.config.robot.retract_speed)
    try:
        _go_up(cycle, state.pose.shifted(z=clear_m - height_m), speed)
    except BreachError as breach:
        cycle.stop()
        logger.warning("no retract: %s", breach.message)
        return f"The arm stopped, but the retract ended early ({breach.message})"
    except AbortedError:
        cycle.stop()
        return "The arm stopped and, asked a second time, holds where it is"
    return "The arm stopped and retracted slowly off the gel"


def _go_up(cycle: Cycle, target: Pose, speed: float) -> None:
    cycle.start_move(target, speed=speed)
    rise_m = target.position[2] - (cycle.last_state.pose.position[2] if cycle.last_state else 0.0)
    deadline_ns = cycle.rig.clock.now_ns() + round((2.0 * rise_m / speed + 2.0) * 1e9)
    while cycle.is_moving():
        try:
            reading_ns = cycle.turn().now_ns
        except BreachError as breach:
            if breach.reaction is not Reaction.RETRACT:
                raise
            reading_ns = cycle.rig.clock.now_ns()
        if reading_ns > deadline_ns:
            raise BreachError(
                "robot: the retract took too long",
                limit="robot.arrival",
                reaction=Reaction.HOLD,
                remedy="see the pendant",
            )
