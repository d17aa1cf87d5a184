"""Press again: attempts at a trial until one passes, and those that only late images cut off."""

from collections.abc import Callable
from typing import TypeVar

from protocols.control.cycle import Cycle
from protocols.control.record_entries_and_rates import Journal
from protocols.guard.breach_reaction import BreachError
from protocols.steps.arm_moves import ARRIVED_M, clear_height
from protocols.steps.safe_end import end_safely
from protocols.trials.attempt_and_criteria import PlannedTrial, run_trial
from tacauchy_rig.core.errors import AbortedError, RigError
from tacauchy_rig.core.run import Phase, TrialRecord

ResultT = TypeVar("ResultT")
ALWAYS_LATE = (
    "images came late in every attempt: end other programs on this computer, and see `tacauchy-rig "
    "doctor`: camera; `resume --set limits.stale_image=...` admits longer gaps"
)


def do_step(
    cycle: Cycle, journal: Journal, phase: Phase, step: Callable[[Cycle], ResultT]
) -> ResultT:
    """Do what comes before the trials; again where nothing but images came late."""
    attempt = 1
    while True:
        journal.enter(phase)
        try:
            return step(cycle)
        except RigError as error:
            end_safely(cycle, journal, error)
            is_last = attempt == cycle.config.protocol.attempts
            if not _goes_again(cycle, journal, error, is_last=is_last, of_phase=phase.value):
                raise
        attempt += 1


def press_until_passed(
    cycle: Cycle,
    journal: Journal,
    planned: PlannedTrial,
    records: dict[int, TrialRecord],
    earlier: list[TrialRecord],
) -> None:
    """Run attempts until one passes; ``records`` keeps the last one whatever happens."""
    last = planned.next_attempt + cycle.config.protocol.attempts - 1
    for attempt in range(planned.next_attempt, last + 1):
        records[planned.index], error = run_trial(
            cycle, journal, planned, attempt=attempt, earlier=earlier
        )
        cut = {"of_trial": planned.index, "of_attempt": attempt}
        if error and not _goes_again(cycle, journal, error, is_last=attempt == last, **cut):
            raise error
        if records[planned.index].passed:
            earlier.append(records[planned.index])
            break


def _goes_again(
    cycle: Cycle, journal: Journal, error: RigError, *, is_last: bool, **cut_off: int | str
) -> bool:
    """Return whether what ``error`` cut off is done again, and say so in the journal."""
    if is_last and images_were_late(error):
        error.remedy = ALWAYS_LATE
    if is_last or not may_repeat(cycle, error):
        return False
    journal.trial = journal.attempt = 0  # its recording is closed
    journal.write("attempt-repeated", **cut_off, reason="only images came late; they are back")
    return True


LATE_IMAGE = "limits.stale_image"
WELL_S = 1.0
"""Images have to come in time for so long, with every other limit kept, before it goes on."""
PATIENCE_S = 10.0
"""How long that is waited for: a longer silence is a camera that is gone."""


def may_repeat(cycle: Cycle, error: RigError) -> bool:
    """Return whether the attempt that ``error`` cut off may be made again now; waits for images.

    Only where images came late: that says nothing of gel, cell or arm, and costs one press. What
    stopped a press by force or arm is for a person to see.

    The arm has been made safe before. It has to stand clear of the gel: one that was told to hold
    does not go on by itself.

    Raises:
        AbortedError: A person asked to stop meanwhile.
    """
    if not images_were_late(error) or cycle.last_state is None:
        return False
    # The retract ends at that height, as nearly as an arm arrives.
    is_clear = cycle.last_state.pose.position[2] >= clear_height(cycle) - ARRIVED_M
    return is_clear and _is_well(cycle)


def images_were_late(error: RigError) -> bool:
    """Return whether nothing but the age of the newest image stopped the arm."""
    return isinstance(error, BreachError) and error.limit == LATE_IMAGE


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
