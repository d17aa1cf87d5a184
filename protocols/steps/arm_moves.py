"""Straight moves of the arm, and coming to rest, watched at every turn."""

import math

from protocols.control.cycle import Cycle
from protocols.guard.breach_reaction import BreachError, Reaction
from protocols.guard.force_limits import Contact
from protocols.guard.workspace_and_speed import describe
from protocols.steps.tare_and_force_window import listen
from tacauchy_rig.core.run import ArmSample, Pose, Vector6

ARRIVED_M = 0.0005
REST_SPEED_M_S = 2e-5
REST_TIMEOUT_S = 0.5
SPARE_S = 3.0
SLOW_M_S = 0.002


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
        if is_at_rest(reading.arm):
            return
        reading = cycle.turn()


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
