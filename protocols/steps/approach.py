"""From home to just above the gel; nothing may be touched on the way."""

from __future__ import annotations

from protocols.cycle import Cycle
from protocols.guard.force import Contact
from protocols.steps.motion import at_height, move_to


def approach(cycle: Cycle) -> None:
    """Go to ``protocol.approach_height`` above the expected surface.

    Raises:
        BreachError: Something was touched, or another limit was passed.
    """
    cycle.force_guard.contact = Contact.NONE
    config = cycle.config
    height_m = config.sensor.surface[2] + config.protocol.approach_height
    move_to(cycle, at_height(cycle, height_m), speed=config.robot.approach_speed)
