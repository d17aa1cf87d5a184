"""Leave the gel."""

from __future__ import annotations

from protocols.cycle import Cycle
from protocols.guard.force import Contact
from protocols.steps.motion import at_height, come_to_rest, home_pose, move_to
from protocols.window import listen

CLEAR_M = 0.001
"""Above contact by this much the gel has let go, however it sticks."""


def retract(cycle: Cycle, *, contact_z_m: float) -> None:
    """Go straight up off the gel and then home.

    Raises:
        BreachError: A limit was passed on the way.
    """
    cycle.force_guard.contact = Contact.LEAVING
    speed = cycle.config.robot.retract_speed
    come_to_rest(cycle)
    move_to(cycle, at_height(cycle, contact_z_m + CLEAR_M), speed=speed)
    # A force sample may be as old as its limit: what it says of the gel is no contact any more.
    listen(cycle, cycle.config.limits.stale_force)
    cycle.force_guard.contact = Contact.NONE
    move_to(cycle, home_pose(cycle), speed=speed)
