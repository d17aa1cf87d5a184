"""Before a run: take the indenter off the gel where an earlier fault has left it there."""

from __future__ import annotations

from protocols.cycle import Cycle
from protocols.guard.force import Contact
from protocols.steps.make_safe import SLOW_M_S
from protocols.steps.motion import move_to
from protocols.steps.tare import take_tare


def leave_gel(cycle: Cycle) -> None:
    """Go straight up, slowly, to ``protocol.approach_height`` above the gel; no higher than that.

    Where the tip is clear of the gel nothing moves. Otherwise the load of the gel is the guard's
    zero, and a force that falls away is expected, until the caller gives it another zero.

    Raises:
        BreachError: A limit was passed, or the arm did not arrive.
    """
    pose = cycle.turn().arm.pose
    clear_m = cycle.config.sensor.surface[2] + cycle.config.protocol.approach_height
    rise_m = clear_m - pose.position[2]
    if rise_m <= 0.0:
        return
    cycle.force_guard.set_zero(take_tare(cycle))
    cycle.force_guard.contact = Contact.LEAVING
    move_to(cycle, pose.shifted(z=rise_m), speed=min(SLOW_M_S, cycle.config.robot.retract_speed))
