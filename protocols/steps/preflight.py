"""Before a run: off the gel, near home, playing, streams alive; the motion once in the air."""

from protocols.control.cycle import Cycle, turns
from protocols.guard.breach_reaction import BreachError, Reaction
from protocols.guard.force_limits import Contact
from protocols.steps import arm_moves as motion
from protocols.steps.tare_and_force_window import judge_tare, listen, take_quiet_tare, take_tare
from tacauchy_rig.core.run import Tare


def leave_gel(cycle: Cycle) -> None:
    """Go straight up, slowly, to ``protocol.approach_height`` above the gel; no higher than that.

    Where the tip is clear of the gel nothing moves. Otherwise the load of the gel is the guard's
    zero, and a force that falls away is expected, until the caller gives it another zero.
    """
    pose = cycle.turn().arm.pose
    rise_m = motion.clear_height(cycle) - pose.position[2]
    if rise_m <= 0.0:
        return
    cycle.force_guard.set_zero(take_tare(cycle))
    cycle.force_guard.contact = Contact.LEAVING
    motion.move_to(
        cycle, pose.shifted(z=rise_m), speed=min(motion.SLOW_M_S, cycle.config.robot.retract_speed)
    )


PLAYING = 2
LISTEN_S = 0.3


def run_preflight(cycle: Cycle) -> Tare:
    """Check the start and give the guard its first zero.

    Raises:
        BreachError: The robot is not ready, or the unloaded force is not quiet or not small.
        SafetyError: The arm is not near home.
    """
    listen(cycle, LISTEN_S)
    state = cycle.turn().arm
    cycle.workspace.check_start(state.pose)
    if state.runtime_state != PLAYING:
        raise BreachError(
            f"robot: its program is not running (runtime_state {state.runtime_state})",
            limit="robot.runtime_state",
            reaction=Reaction.HOLD,
            remedy="see the pendant for a message",
        )
    leave_gel(cycle)
    tare = take_quiet_tare(cycle)
    for criterion in judge_tare(tare, cycle.config):
        if not criterion.passed:
            raise BreachError(
                f"protocol.{criterion.name}: the unloaded force sensor gives "
                f"{criterion.measured:.3f} {criterion.unit}, {criterion.limit} is allowed",
                limit=f"protocol.{criterion.name}",
                reaction=Reaction.HOLD,
                remedy=criterion.remedy,
            )
    cycle.force_guard.set_zero(tare)
    cycle.force_guard.contact = Contact.NONE
    return tare


TRAVEL_M = 0.001
OVERRUN_LIMIT_M = 0.0003


def press_air(cycle: Cycle) -> dict[str, float]:
    """Go down by 1 mm at search speed, ``air_press_height`` above the gel, stop, and go home.

    Returns:
        ``overrun_m``, the travel from the stop command to rest, and ``peak_force_n``, the largest
        force felt where nothing touches.
    """
    cycle.force_guard.contact = Contact.NONE
    robot, protocol = cycle.config.robot, cycle.config.protocol
    top_m = cycle.config.sensor.surface[2] + protocol.air_press_height + TRAVEL_M
    motion.move_to(cycle, motion.home_pose(cycle), speed=robot.approach_speed)
    motion.move_to(cycle, motion.at_height(cycle, top_m), speed=robot.approach_speed)
    peak_n = _descend(cycle, top_m - TRAVEL_M)
    stop_m = cycle.turn().arm.pose.position[2]
    motion.come_to_rest(cycle)
    overrun_m = stop_m - cycle.turn().arm.pose.position[2]
    if overrun_m > OVERRUN_LIMIT_M:
        raise BreachError(
            f"robot: it went on for {overrun_m * 1e3:.3f} mm after the stop, more than "
            f"{OVERRUN_LIMIT_M * 1e3:g} mm",
            limit="robot.overrun",
            reaction=Reaction.HOLD,
            remedy="raise robot.acceleration or lower the speeds",
        )
    motion.move_to(cycle, motion.home_pose(cycle), speed=robot.retract_speed)
    return {"overrun_m": overrun_m, "peak_force_n": peak_n}


def _descend(cycle: Cycle, floor_m: float) -> float:
    speed = cycle.config.robot.search_speed
    cycle.set_velocity(motion.downward(speed))
    peak_n = 0.0
    for reading in turns(cycle.turn, 2.0 * TRAVEL_M / speed + 1.0):
        peak_n = max([peak_n, *(abs(press.force_n) for press in reading.presses)])
        if reading.arm.pose.position[2] <= floor_m:
            return peak_n
    raise BreachError(
        f"robot: it did not go down by {TRAVEL_M * 1e3:g} mm when commanded",
        limit="robot.air_press",
        reaction=Reaction.HOLD,
        remedy="see the speed slider on the pendant and robot.tool_rotation",
    )
