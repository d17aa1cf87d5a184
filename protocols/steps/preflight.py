"""Before a trial: near home, playing, streams alive, off the gel, a first zero for the guard."""

from __future__ import annotations

from protocols.cycle import Cycle
from protocols.guard.breach import BreachError, Reaction
from protocols.guard.force import Contact
from protocols.steps.leave_gel import leave_gel
from protocols.steps.tare import judge_tare, take_quiet_tare
from protocols.window import listen
from tacauchy_rig.run import Tare

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
