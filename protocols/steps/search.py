"""Find the gel by force: once at search speed, then again slowly for the height."""

from __future__ import annotations

from collections import deque

from protocols.control.cycle import Cycle, Reading
from protocols.guard.breach import BreachError, Reaction
from protocols.guard.force import Contact
from protocols.steps.motion import come_to_rest, downward

AVERAGED_SAMPLES = 3
BACK_OFF_M = 0.00015
REFINE_RATIO = 5.0


def search_contact(cycle: Cycle) -> float:
    """Go down until the gel answers; return the tip's height [m] at contact.

    The height is where the averaged force passes ``protocol.contact_force``, so it lies below the
    free surface by that force over the gel's stiffness.

    Raises:
        BreachError: Nothing was touched within ``protocol.search_travel``.
    """
    cycle.force_guard.contact = Contact.EXPECTED
    speed = cycle.config.robot.search_speed
    start_m = cycle.turn().arm.pose.position[2]
    floor_m = start_m - cycle.config.protocol.search_travel
    _descend_to_contact(cycle, speed, floor_m)
    come_to_rest(cycle)
    _back_off(cycle, speed)
    return _descend_to_contact(cycle, speed / REFINE_RATIO, floor_m)


def _descend_to_contact(cycle: Cycle, speed: float, floor_m: float) -> float:
    reading = cycle.turn()
    travel_m = reading.arm.pose.position[2] - floor_m
    deadline_ns = reading.now_ns + round((1.5 * travel_m / speed + 2.0) * 1e9)
    recent: deque[float] = deque(maxlen=AVERAGED_SAMPLES)
    cycle.set_velocity(downward(speed))
    while not _is_touching(recent, cycle.config.protocol.contact_force):
        reading = cycle.turn()
        _check_travel(reading, floor_m, deadline_ns)
        recent.extend(press.force_n for press in reading.presses)
    return reading.arm.pose.position[2]


def _is_touching(recent: deque[float], contact_force_n: float) -> bool:
    return len(recent) == AVERAGED_SAMPLES and sum(recent) / AVERAGED_SAMPLES >= contact_force_n


def _check_travel(reading: Reading, floor_m: float, deadline_ns: int) -> None:
    height_m = reading.arm.pose.position[2]
    if height_m < floor_m or reading.now_ns > deadline_ns:
        raise BreachError(
            f"protocol.search_travel: nothing was touched down to z = {height_m * 1e3:.2f} mm",
            limit="protocol.search_travel",
            reaction=Reaction.RETRACT,
            remedy="see whether the sensor is under the indenter; check sensor.surface",
        )


def _back_off(cycle: Cycle, speed: float) -> None:
    reading = cycle.turn()
    goal_m = reading.arm.pose.position[2] + BACK_OFF_M
    deadline_ns = reading.now_ns + round((3.0 * BACK_OFF_M / speed + 1.0) * 1e9)
    cycle.set_velocity(downward(-speed))
    while reading.arm.pose.position[2] < goal_m and reading.now_ns < deadline_ns:
        reading = cycle.turn()
    come_to_rest(cycle)
