"""Straight moves of the arm, the search for the gel, and the safe end after a fault or an abort.

The gel is found by force: down until it answers, a little up, and down again slowly.
"""

import logging
import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

from protocols.control.cycle import Cycle, Journal, Press, turns
from protocols.guard.breach_reaction import BreachError, Reaction, reaction_to
from protocols.guard.force_limits import Contact
from protocols.guard.place_and_motion import Floor, describe, search_floor
from protocols.steps.tare_and_force_window import listen
from tacauchy_rig.core.config.settings import REFINE_RATIO, RigConfig
from tacauchy_rig.core.errors import AbortedError, DeviceError, RigError
from tacauchy_rig.core.force_sensor_gain import ARM_ZERO_S
from tacauchy_rig.core.run import ArmSample, Phase, Pose, Vector6

logger = logging.getLogger(__name__)

ARRIVED_M = 0.0005
REST_SPEED_M_S = 2e-5
REST_TIMEOUT_S = 0.5
SPARE_S = 3.0
SLOW_M_S = 0.002


def move_to(cycle: Cycle, target: Pose, *, speed: float) -> None:
    """Move in a straight line [m/s] and return on arrival."""
    start = cycle.turn().arm.pose
    distance = math.dist(start.position, target.position)
    cycle.start_move(target, speed=speed)
    for _ in turns(cycle.turn, 1.5 * distance / speed + SPARE_S):
        if not cycle.is_moving():
            break
    else:
        cycle.stop()
        raise _not_arrived(target, cycle.turn().arm.pose, "in time")
    reading = cycle.turn()
    if math.dist(reading.arm.pose.position, target.position) > ARRIVED_M:
        raise _not_arrived(target, reading.arm.pose, "there")


def come_to_rest(cycle: Cycle) -> None:
    """Stop and turn until the arm stands still, at most ``REST_TIMEOUT_S``."""
    cycle.stop()
    for reading in turns(cycle.turn, REST_TIMEOUT_S):
        if is_at_rest(reading.arm):
            return


def is_at_rest(state: ArmSample) -> bool:
    """Return whether the arm stands still."""
    return math.hypot(*state.velocity[:3]) < REST_SPEED_M_S


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
        if rested_ms is None and state is not None and is_new and is_at_rest(state):
            rested_ms = (state.stamp_ns - stop_ns) * 1e-6
    return rested_ms, peak_n, worst


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


AVERAGED_SAMPLES = 3
BACK_OFF_M = 0.00015


def search_contact(cycle: Cycle) -> float:
    """Go down until the gel answers; return the tip's height [m] at contact.

    The height is where the averaged force passes ``protocol.contact_force``, so it lies below the
    free surface by that force over the gel's stiffness.
    """
    listen(cycle, ARM_ZERO_S)
    cycle.force_guard.contact = Contact.EXPECTED
    cycle.witness.begin_search()
    speed = cycle.config.robot.search_speed
    start_m = cycle.turn().arm.pose.position[2]
    floor = search_floor(cycle.config, start_m=start_m, contact_m=cycle.contact_z_m)
    _descend_to_contact(cycle, speed, floor)
    come_to_rest(cycle)
    _back_off(cycle, speed)
    return _descend_to_contact(cycle, speed / REFINE_RATIO, floor)


def _descend_to_contact(cycle: Cycle, speed: float, floor: Floor) -> float:
    reading = cycle.turn()
    travel_m = reading.arm.pose.position[2] - floor.height_m
    deadline_ns = reading.now_ns + round((1.5 * travel_m / speed + 2.0) * 1e9)
    recent: deque[Press] = deque(maxlen=AVERAGED_SAMPLES)
    before_n: float | None = None
    cycle.set_velocity(downward(speed))
    while True:
        reading = cycle.turn()
        recent.extend(reading.presses)
        if len(recent) == AVERAGED_SAMPLES:
            force_n = sum(press.force_n for press in recent) / AVERAGED_SAMPLES
            if force_n >= cycle.config.protocol.contact_force:
                return reading.arm.pose.position[2]
            before_n = force_n if before_n is None else before_n
            _check_direction(cycle.config, recent, force_n, before_n)
        floor.check(reading.arm.pose.position[2], is_late=reading.now_ns > deadline_ns)


def _check_direction(
    config: RigConfig, recent: Iterable[Press], force_n: float, before_n: float
) -> None:
    """Refuse a force that grows the other way, or sideways, while the tip goes down."""
    contact_n = config.protocol.contact_force
    if force_n - before_n <= -contact_n:
        raise BreachError(
            f"force_sensor.compression_sign {config.force_sensor.compression_sign}: the force went "
            f"to {force_n:.3f} N on the way down, where pressing should count as positive",
            limit="force_sensor.compression_sign",
            reaction=Reaction.RETRACT,
            remedy="the sensor's sign is the other one: set force_sensor.compression_sign = "
            f"{-config.force_sensor.compression_sign}; or its reading jumped (range, unit or axes "
            "in its box)",
        )
    sideways_n = sum(press.sideways_n for press in recent) / AVERAGED_SAMPLES
    if sideways_n > config.limits.early_contact:
        raise BreachError(
            f"limits.early_contact {config.limits.early_contact:g} N: the force sensor says "
            f"{sideways_n:.3f} N sideways and {force_n:.3f} N along its axis on the way down",
            limit="witness.sideways",
            reaction=Reaction.RETRACT,
            remedy="the sensor's axes are swapped, or its decoupling matrix is another cell's; or "
            "something beside the gel was touched",
        )


def _back_off(cycle: Cycle, speed: float) -> None:
    goal_m = cycle.turn().arm.pose.position[2] + BACK_OFF_M
    cycle.set_velocity(downward(-speed))
    for reading in turns(cycle.turn, 3.0 * BACK_OFF_M / speed + 1.0):
        if reading.arm.pose.position[2] >= goal_m:
            break
    come_to_rest(cycle)
