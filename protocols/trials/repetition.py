"""Which attempts are made again although a fault cut them off: those whose images came late.

Force and arm are not asked twice: what stopped a press by them is for a person to see. A gap
between two images on a busy computer says nothing of gel, cell or arm, and costs one press.
"""

from __future__ import annotations

from protocols.control.cycle import Cycle
from protocols.guard.breach import BreachError
from protocols.steps.motion import ARRIVED_M
from tacauchy_rig.core.errors import AbortedError, RigError

LATE_IMAGE = "limits.stale_image"
WELL_S = 1.0
"""Images have to come in time for so long, with every other limit kept, before it goes on."""
PATIENCE_S = 10.0
"""How long that is waited for: a longer silence is a camera that is gone."""


def may_repeat(cycle: Cycle, error: RigError) -> bool:
    """Return whether the attempt that ``error`` cut off may be made again now; waits for images.

    The arm has been made safe before. It has to stand clear of the gel: one that was told to hold
    does not go on by itself.

    Raises:
        AbortedError: A person asked to stop meanwhile.
    """
    return images_were_late(error) and _is_clear(cycle) and _is_well(cycle)


def images_were_late(error: RigError) -> bool:
    """Return whether nothing but the age of the newest image stopped the arm."""
    return isinstance(error, BreachError) and error.limit == LATE_IMAGE


def _is_clear(cycle: Cycle) -> bool:
    config, state = cycle.config, cycle.last_state
    clear_m = config.sensor.surface[2] + config.protocol.approach_height
    # The retract ends at that height, as nearly as an arm arrives.
    return state is not None and state.pose.position[2] >= clear_m - ARRIVED_M


def _is_well(cycle: Cycle) -> bool:
    clock = cycle.rig.clock
    start_ns = well_since_ns = clock.now_ns()
    while clock.now_ns() - start_ns < PATIENCE_S * 1e9:
        try:
            cycle.turn()
        except BreachError as breach:
            if breach.limit != LATE_IMAGE:
                return False
            well_since_ns = clock.now_ns()
        except AbortedError as abort:
            raise AbortedError(
                f"{abort.message} while waiting for images. The arm stands clear of the gel."
            ) from abort
        if clock.now_ns() - well_since_ns >= WELL_S * 1e9:
            return True
    return False
