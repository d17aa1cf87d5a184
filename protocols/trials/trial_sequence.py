"""All trials of a run, in order, each until it passes or its tries are used up."""

from collections.abc import Sequence, Set
from dataclasses import dataclass

from protocols.control.cycle import Cycle
from protocols.control.record_entries_and_rates import Journal
from protocols.guard.breach_reaction import BreachError
from protocols.steps.preflight import press_air, run_preflight
from protocols.trials.attempt_and_criteria import PlannedTrial, do_step, press_until_passed
from tacauchy_rig.core.errors import AbortedError, RigError
from tacauchy_rig.core.force_sensor_gain import FORCE_HISTORY, FORCE_LIMITS
from tacauchy_rig.core.run import Outcome, Phase, TrialRecord
from tacauchy_rig.core.store.run_store import RunStore
from tacauchy_rig.core.store.trusted_force import force_series

_RESUME = "`tacauchy-rig resume` continues with the next unfinished trial"


@dataclass(frozen=True, slots=True, kw_only=True)
class ProgrammeResult:
    """How a run ended."""

    outcome: Outcome
    records: tuple[TrialRecord, ...]  # the last attempt of each trial that was tried in this run
    reason: str = ""  # what went wrong, where the arm is and which trials are safe
    remedy: str = ""


def _remedy(error: RigError, *, doubted: bool) -> str:
    """Return the error's remedy and, unless the force sensor is in doubt, how the run goes on."""
    if not error.remedy:
        return _RESUME
    return error.remedy if doubted or "resume" in error.remedy else f"{error.remedy}; {_RESUME}"


def run_programme(cycle: Cycle, journal: Journal, plan: Sequence[PlannedTrial]) -> ProgrammeResult:
    """Preflight, air press, then each trial that is not done. Ends with the arm at rest.

    The lowest height at which an earlier session found the gel bounds the first search.
    """
    records: dict[int, TrialRecord] = {}
    found_m = [planned.contact_z_m for planned in plan if planned.contact_z_m is not None]
    cycle.contact_z_m = min(found_m, default=None)
    earlier = [planned.record for planned in plan if planned.record is not None]
    try:
        do_step(cycle, journal, Phase.PREFLIGHT, run_preflight)
        journal.write("air-press", **do_step(cycle, journal, Phase.AIR_PRESS, press_air))
        for planned in plan:
            if not planned.done:
                press_until_passed(cycle, journal, planned, records, earlier)
    except RigError as error:
        safe = [planned.index for planned in plan if planned.done]
        safe += [index for index, record in records.items() if record.passed]
        doubted = isinstance(error, BreachError) and error.limit in {*FORCE_LIMITS, FORCE_HISTORY}
        what = describe_doubted if doubted else describe_safe
        return ProgrammeResult(
            outcome=Outcome.ABORTED if isinstance(error, AbortedError) else Outcome.FAULT,
            records=tuple(records.values()),
            reason=f"{error.message} {what(sorted(safe))}",
            remedy=_remedy(error, doubted=doubted),
        )
    finally:
        cycle.stop()
    missed = [str(index) for index, record in records.items() if not record.passed]
    return ProgrammeResult(
        outcome=Outcome.FAILED if missed else Outcome.PASSED,
        records=tuple(records.values()),
        reason=f"trials without a passed attempt: {', '.join(missed)}" if missed else "",
        remedy="`tacauchy-rig resume` tries them again" if missed else "",
    )


def describe_safe(indices: Sequence[int]) -> str:
    """Return which trials are kept, as a sentence."""
    if not indices:
        return "No trial has passed yet."
    if len(indices) == 1:
        return f"Trial {indices[0]} is safe."
    if indices[-1] - indices[0] + 1 == len(indices):
        return f"Trials {indices[0]} to {indices[-1]} are safe."
    return f"Trials {', '.join(map(str, indices))} are safe."


def describe_doubted(indices: Sequence[int]) -> str:
    """Return that trials which passed are not kept, as a sentence."""
    if not indices:
        return describe_safe(indices)
    which = describe_safe(indices).removesuffix(" safe.")
    it = "it" if len(indices) == 1 else "them"
    return f"{which} in doubt as well: the same sensor measured {it}."


def plan_session(store: RunStore, *, again: Set[int] = frozenset()) -> tuple[PlannedTrial, ...]:
    """Return what is left to do: trials without a passed attempt, numbered after earlier ones.

    An attempt whose force sensor was found faulty since does not count, nor do those of ``again``.
    """
    plan, doubted = [], force_series(store).doubted
    for index, target_n in enumerate(store.config.protocol.force_targets, start=1):
        passed = store.accepted(index)
        done = passed is not None and index not in again and (index, passed.attempt) not in doubted
        plan.append(
            PlannedTrial(
                index=index,
                force_target_n=target_n,
                next_attempt=store.next_attempt(index),
                done=done,
                contact_z_m=None if passed is None else passed.contact_z_m,
                record=passed if done else None,
            )
        )
    return tuple(plan)
