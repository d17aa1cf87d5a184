"""Before a trial: off the gel, near home, playing, streams alive, a first zero for the guard."""

from __future__ import annotations

from protocols.control.cycle import Cycle
from protocols.control.window import listen
from protocols.guard.breach import BreachError, Reaction
from protocols.guard.force import Contact
from protocols.steps.make_safe import SLOW_M_S
from protocols.steps.motion import move_to
from protocols.steps.tare import judge_tare, take_quiet_tare, take_tare
from tacauchy_rig.run import Tare


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


PLAYING = 2
LOOK_S = 0.3


def run_preflight(cycle: Cycle) -> Tare:
    """Check the start and give the guard its first zero.

    Raises:
        BreachError: The robot is not ready, or the unloaded force is not quiet or not small.
        SafetyError: The arm is not near home.
    """
    listen(cycle, LOOK_S)
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
