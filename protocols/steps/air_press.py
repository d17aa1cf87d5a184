"""The whole motion once in the air, high above the gel, before anything is touched."""

from __future__ import annotations

from protocols.control.cycle import Cycle
from protocols.guard.breach import BreachError, Reaction
from protocols.guard.force import Contact
from protocols.steps.motion import at_height, come_to_rest, downward, home_pose, move_to

TRAVEL_M = 0.001
OVERRUN_LIMIT_M = 0.0003


def press_air(cycle: Cycle) -> dict[str, float]:
    """Go down by 1 mm at search speed, ``air_press_height`` above the gel, stop, and go home.

    Returns:
        ``overrun_m``, the travel from the stop command to rest, and ``peak_force_n``, the largest
        force felt where nothing touches.

    Raises:
        BreachError: Something was felt, or the arm did not move or stop as it was told.
    """
    cycle.force_guard.contact = Contact.NONE
    robot, protocol = cycle.config.robot, cycle.config.protocol
    top_m = cycle.config.sensor.surface[2] + protocol.air_press_height + TRAVEL_M
    move_to(cycle, home_pose(cycle), speed=robot.approach_speed)
    move_to(cycle, at_height(cycle, top_m), speed=robot.approach_speed)
    peak_n = _descend(cycle, top_m - TRAVEL_M)
    told_m = cycle.turn().arm.pose.position[2]
    come_to_rest(cycle)
    overrun_m = told_m - cycle.turn().arm.pose.position[2]
    if overrun_m > OVERRUN_LIMIT_M:
        raise BreachError(
            f"robot: it went on for {overrun_m * 1e3:.3f} mm after the stop, more than "
            f"{OVERRUN_LIMIT_M * 1e3:g} mm",
            limit="robot.overrun",
            reaction=Reaction.HOLD,
            remedy="raise robot.acceleration or lower the speeds",
        )
    move_to(cycle, home_pose(cycle), speed=robot.retract_speed)
    return {"overrun_m": overrun_m, "peak_force_n": peak_n}


def _descend(cycle: Cycle, floor_m: float) -> float:
    speed = cycle.config.robot.search_speed
    reading = cycle.turn()
    deadline_ns = reading.now_ns + round((2.0 * TRAVEL_M / speed + 1.0) * 1e9)
    cycle.set_velocity(downward(speed))
    peak_n = 0.0
    while reading.arm.pose.position[2] > floor_m:
        if reading.now_ns > deadline_ns:
            raise BreachError(
                f"robot: it did not go down by {TRAVEL_M * 1e3:g} mm when it was told to",
                limit="robot.air_press",
                reaction=Reaction.HOLD,
                remedy="see the speed slider on the pendant and robot.tool_rotation",
            )
        reading = cycle.turn()
        peak_n = max([peak_n, *(abs(press.force_n) for press in reading.presses)])
    return peak_n
