"""Find the gel by force: down until it answers, a little up, and down again slowly."""

from collections import deque
from collections.abc import Iterable

from protocols.control.cycle import Cycle, Press
from protocols.guard.breach_reaction import BreachError, Reaction
from protocols.guard.depth_limits import Floor, search_floor
from protocols.guard.force_limits import Contact
from protocols.steps.arm_moves import come_to_rest, downward
from protocols.steps.tare_and_force_window import listen
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.config.stated_uncertainty import REFINE_RATIO
from tacauchy_rig.core.force_sensor_gain import ARM_ZERO_S

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
    reading = cycle.turn()
    goal_m = reading.arm.pose.position[2] + BACK_OFF_M
    deadline_ns = reading.now_ns + round((3.0 * BACK_OFF_M / speed + 1.0) * 1e9)
    cycle.set_velocity(downward(-speed))
    while reading.arm.pose.position[2] < goal_m and reading.now_ns < deadline_ns:
        reading = cycle.turn()
    come_to_rest(cycle)
