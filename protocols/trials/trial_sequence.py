"""All trials of a run in order, and attempts at each, from home to home, with their criteria."""

from collections.abc import Callable, Iterator, Sequence, Set
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from drivers.interfaces import TouchMode
from protocols.control.cycle import Begin, Cycle, End, Journal, RateMeter
from protocols.guard.breach_reaction import BreachError, Reaction
from protocols.guard.force_limits import Contact
from protocols.steps.arm_moves import (
    ARRIVED_M,
    approach,
    clear_height,
    end_safely,
    home_pose,
    move_to,
    retract,
    search_contact,
)
from protocols.steps.force_servo_hold_sway import PressDrive, hold, press_to_target, settle, sway
from protocols.steps.preflight import press_air, run_preflight
from protocols.steps.tare_and_force_window import (
    force_drift,
    judge_tare,
    listen,
    take_quiet_tare,
    take_tare,
)
from tacauchy_rig.core.errors import AbortedError, RigError
from tacauchy_rig.core.force_sensor_gain import (
    FORCE_HISTORY,
    FORCE_LIMITS,
    WEIGH_REMEDY,
    judge_forces,
)
from tacauchy_rig.core.run import Criterion, Outcome, Phase, TrialRecord
from tacauchy_rig.core.store.run_store import RunStore
from tacauchy_rig.core.store.trusted_force import force_series

MIN_DWELL_FRAMES = 5
MIN_REFERENCE_FRAMES = 3
MAX_CLIPPED_RATIO = 0.25
"""Of the pixels of an image at full scale; a lit gel has next to none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedTrial:
    """A trial that may still have to be run."""

    index: int
    force_target_n: float
    next_attempt: int = 1  # number of its next attempt; attempts are never overwritten
    done: bool = False  # true when an earlier session has an attempt that passed
    # Height at which an earlier session's passed attempt found the gel [m].
    contact_z_m: float | None = None
    record: TrialRecord | None = None  # of the attempt that passed, where ``done``


def run_trial(
    cycle: Cycle,
    journal: Journal,
    trial: PlannedTrial,
    *,
    attempt: int,
    earlier: Sequence[TrialRecord] = (),
) -> tuple[TrialRecord, RigError | None]:
    """Run one attempt; its record is kept whatever happens.

    ``earlier`` are the trials that passed before: the forces of all of them must agree.

    Returns:
        The record, and what cut the attempt off (a breach, an abort or a refusal), after the arm
        was made safe, or what is wrong with the force sensor after all; None where it ran to its
        end.
    """
    journal.trial, journal.attempt = trial.index, attempt
    cycle.rates = RateMeter()
    made = _Attempt(cycle, journal, trial, attempt)
    error: RigError | None = None
    try:
        cycle.sink.put(Begin(trial.index, attempt))
        journal.write("attempt-start", force_target_n=trial.force_target_n)
        made.press()
        error = made.judge(earlier)
    except RigError as problem:
        error = problem
        made.end_safely(problem)
    made.finish()
    return made.record, error


class _Attempt:
    """One attempt: ``record`` is filled step by step with what was found."""

    def __init__(self, cycle: Cycle, journal: Journal, trial: PlannedTrial, attempt: int) -> None:
        self._cycle, self._journal, self._config = cycle, journal, cycle.config
        self._settled = False  # whether the force settled before the dwell
        self.record = TrialRecord(
            index=trial.index,
            attempt=attempt,
            outcome=Outcome.FAULT,
            force_target_n=trial.force_target_n,
        )

    def _found(self, **fields: Any) -> None:
        self.record = replace(self.record, **fields)

    def press(self) -> None:
        """Do the steps from home to home; a noisy tare ends them early."""
        cycle, config, enter = self._cycle, self._config, self._journal.enter
        camera, clock, target_n = cycle.rig.camera, cycle.rig.clock, self.record.force_target_n
        cycle.force_guard.contact = Contact.NONE
        enter(Phase.HOME)
        move_to(cycle, home_pose(cycle), speed=config.robot.approach_speed)
        enter(Phase.TARE)
        tare = take_quiet_tare(cycle)
        self._found(tare_before=tare)
        if not all(criterion.passed for criterion in judge_tare(tare, config)):
            return
        cycle.force_guard.set_zero(tare)
        enter(Phase.REFERENCE)
        camera.ask(TouchMode.REFERENCE)
        start_ns = clock.now_ns()
        listen(cycle, config.protocol.reference_duration)
        self._found(reference_start_ns=start_ns, reference_end_ns=clock.now_ns())
        enter(Phase.APPROACH)
        approach(cycle)
        enter(Phase.SEARCH, witnesses=cycle.witness.present(), force_sign=config.robot.force_sign)
        camera.ask(TouchMode.TOUCH)
        contact_z_m = search_contact(cycle)
        camera.ask(TouchMode.NOTHING)
        self._found(contact_z_m=contact_z_m)
        enter(Phase.PRESS, contact_z_m=contact_z_m, force_target_n=target_n)
        drive = PressDrive(cycle, target_n=target_n, contact_z_m=contact_z_m)
        press_to_target(cycle, drive)
        depth_m, force_n = zip(*cycle.witness.path(), strict=True)
        self._found(press_depth_m=depth_m, press_force_n=force_n)
        self._settled = settle(cycle, drive)
        enter(Phase.DWELL, force_n=cycle.last_force_n)
        self.record = hold(cycle, drive, self.record)
        cycle.contact_z_m = contact_z_m
        cycle.witness.remember_press()
        if config.protocol.sway > 0.0:
            enter(Phase.SWAY)
            sway(cycle, drive)
        enter(Phase.RETRACT, force_mean_n=self.record.force_measured_n)
        retract(cycle, contact_z_m=contact_z_m)
        enter(Phase.DRIFT_CHECK)
        after = take_tare(cycle)
        self._found(tare_after=after, force_drift_n=force_drift(tare, after, config=config))

    def judge(self, earlier: Sequence[TrialRecord]) -> BreachError | None:
        """Compare what was found with its criteria; return what the forces of all trials show."""
        self._journal.enter(Phase.VERDICT)
        error = None
        rates = self._cycle.rates.report()
        criteria = tuple(self._criteria(rates))
        if all(criterion.passed for criterion in criteria):
            history = judge_forces((*earlier, self.record), self._config.robot.model)
            criteria += (history.criterion(),)
            if history.fault:
                error = BreachError(
                    f"{history.fault}. The arm is at home.",
                    limit=FORCE_HISTORY,
                    reaction=Reaction.HOLD,
                    remedy=WEIGH_REMEDY,
                )
        missed = [criterion.name for criterion in criteria if not criterion.passed]
        is_cut = self.record.force_measured_n is None
        self._found(
            outcome=Outcome.FAILED if missed or is_cut else Outcome.PASSED,
            rates=rates,
            reason=f"missed: {', '.join(missed)}" if missed else "",
            criteria=criteria,
        )
        return error

    def end_safely(self, error: RigError) -> None:
        """Make the arm safe after ``error``, and note how it ended."""
        end_safely(self._cycle, self._journal, error, of=f" of trial {self.record.index}")
        self._found(
            outcome=Outcome.ABORTED if isinstance(error, AbortedError) else Outcome.FAULT,
            rates=self._cycle.rates.report(),
            reason=error.message,
            limit=error.limit if isinstance(error, BreachError) else "",
        )

    def finish(self) -> None:
        """Tell the record and whoever watches how it ended."""
        record = self.record
        self._journal.write(
            "attempt-end",
            outcome=record.outcome.value,
            reason=record.reason,
            force_measured_n=record.force_measured_n,
            depth_measured_m=record.depth_measured_m,
        )
        self._cycle.sink.put(End(record, self._cycle.rig.clock.now_ns()))

    def _criteria(self, rates: dict[str, float]) -> Iterator[Criterion]:
        record, config, arrived = self.record, self._config, self._cycle.rates
        protocol, limits = config.protocol, config.limits
        reference = record.reference_start_ns or 0, record.reference_end_ns or 0
        dwell = record.dwell_start_ns or 0, record.dwell_end_ns or 0
        at_most, at_least = Criterion.at_most, Criterion.at_least
        if record.tare_before is not None:
            yield from judge_tare(record.tare_before, config)
        if record.force_measured_n is not None and record.force_rate_n_s is not None:
            error_n = abs(record.force_measured_n - record.force_target_n)
            remedy = "raise protocol.settle_timeout, or force_tolerance if the noise is larger"
            yield at_most("force_mean", error_n, protocol.force_tolerance, unit="N", remedy=remedy)
            slope_n_s, most_n_s = abs(record.force_rate_n_s), protocol.dwell_force_rate
            remedy = "the gel was still creeping: raise protocol.settle_timeout"
            yield at_most("force_rate", slope_n_s, most_n_s, unit="N/s", remedy=remedy)
            yield Criterion(
                name="settled",
                passed=self._settled,
                measured=float(self._settled),
                limit="the force settled before the dwell",
                unit="",
                remedy="raise protocol.settle_timeout",
            )
            yield _frames("dwell_frames", arrived.frame_count(*dwell), MIN_DWELL_FRAMES)
            repeated = float(arrived.repeated_frame_count(reference, dwell))
            remedy = "the camera sent the same bytes twice, so its picture is an old one: "
            remedy += "unplug it and plug it in again"
            yield at_most("repeated_frames", repeated, 0.0, unit="frames", remedy=remedy)
        if record.reference_start_ns is not None:
            yield _frames("reference_frames", arrived.frame_count(*reference), MIN_REFERENCE_FRAMES)
        if record.force_drift_n is not None:
            remedy = "let the force sensor warm up; keep draughts off; shorten the trial"
            drift_n = abs(record.force_drift_n)
            yield at_most("force_drift", drift_n, protocol.drift, unit="N", remedy=remedy)
        for name, least, part in (
            ("force_rate_hz", protocol.min_force_rate, "serial port"),
            ("image_rate_hz", protocol.min_image_rate, "camera"),
        ):
            remedy = f"see `tacauchy-rig doctor`: {part}"
            yield at_least(name, rates[name], least, unit="Hz", remedy=remedy)
        for name in ("force", "image"):
            lost = rates[f"{name}_lost_count"]
            share = lost / max(lost + rates[f"{name}_count"], 1.0)
            remedy = f"see `tacauchy-rig doctor`: the {name} stream loses or damages data"
            yield at_most(f"{name}_lost_ratio", share, limits.corrupt_ratio, remedy=remedy)
        remedy = "too much light: lower camera.exposure and camera.gain, keep daylight off the gel"
        clipped = rates["image_clipped_ratio"]
        yield at_most("image_clipped_ratio", clipped, MAX_CLIPPED_RATIO, remedy=remedy)


def _frames(name: str, count: int, least: int) -> Criterion:
    remedy = "see `tacauchy-rig doctor`: the rate that the camera really gives"
    return Criterion.at_least(name, float(count), least, unit="frames", remedy=remedy)


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
        return ProgrammeResult(
            outcome=Outcome.ABORTED if isinstance(error, AbortedError) else Outcome.FAULT,
            records=tuple(records.values()),
            reason=f"{error.message} {describe_safe(sorted(safe), doubted=doubted)}",
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


def describe_safe(indices: Sequence[int], *, doubted: bool = False) -> str:
    """Return that trials which passed are kept, or are doubted now, as a sentence."""
    if not indices:
        return "No trial has passed yet."
    trials, it = f"Trial {indices[0]} is", "it"
    if len(indices) > 1:
        is_range = indices[-1] - indices[0] + 1 == len(indices)
        listed = f"{indices[0]} to {indices[-1]}" if is_range else ", ".join(map(str, indices))
        trials, it = f"Trials {listed} are", "them"
    return f"{trials} {f'in doubt as well: the same sensor measured {it}' if doubted else 'safe'}."


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
