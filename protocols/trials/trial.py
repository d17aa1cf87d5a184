"""One attempt at a trial, from home to home."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

from drivers.camera.touch import Look
from protocols.control.cycle import Cycle
from protocols.control.journal import Journal
from protocols.control.rates import RateMeter
from protocols.control.record import Begin, End
from protocols.control.window import listen
from protocols.guard.breach import BreachError, reaction_to
from protocols.guard.force import Contact
from protocols.steps.make_safe import make_safe
from protocols.steps.motion import approach, home_pose, move_to, retract
from protocols.steps.press import PressDrive, hold, press_to_target, settle
from protocols.steps.search import search_contact
from protocols.steps.sway import sway
from protocols.steps.tare import force_drift, judge_tare, take_quiet_tare, take_tare
from protocols.trials.verdict import Findings, judge
from tacauchy_rig.core.errors import AbortedError, RecordError, RigError
from tacauchy_rig.core.run import Outcome, Phase, TrialRecord

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedTrial:
    """A trial that may still have to be run.

    Attributes:
        index: Counts from 1.
        next_attempt: Number of its next attempt; attempts are never overwritten.
        done: True when an earlier session has an attempt that passed.
        contact_z_m: Height at which an earlier session's passed attempt found the gel [m].
    """

    index: int
    force_target_n: float
    next_attempt: int = 1
    done: bool = False
    contact_z_m: float | None = None


def run_trial(
    cycle: Cycle, journal: Journal, trial: PlannedTrial, *, attempt: int
) -> tuple[TrialRecord, RigError | None]:
    """Run one attempt; its record is kept whatever happens.

    Returns:
        The record, and what cut the attempt off (a breach, an abort or a refusal), after the arm
        was made safe; None where it ran to its end.
    """
    index, target_n = trial.index, trial.force_target_n
    findings = Findings(
        record=TrialRecord(
            index=index, attempt=attempt, outcome=Outcome.FAULT, force_target_n=target_n
        )
    )
    journal.trial, journal.attempt = index, attempt
    cycle.rates = RateMeter()
    error: RigError | None = None
    try:
        cycle.sink.put(Begin(index, attempt))
        journal.write("attempt-start", force_target_n=target_n)
        _press_once(cycle, journal, findings)
        record = _judge(cycle, journal, findings)
    except RigError as problem:
        error = problem
        record = _record_fault(cycle, journal, findings, problem)
    _finish(cycle, journal, record)
    return record, error


def _judge(cycle: Cycle, journal: Journal, findings: Findings) -> TrialRecord:
    journal.enter(Phase.VERDICT)
    rates = cycle.rates.report()
    criteria = tuple(judge(findings, cycle.config, rates))
    missed = [criterion.name for criterion in criteria if not criterion.passed]
    is_cut = findings.record.force_measured_n is None
    return replace(
        findings.record,
        outcome=Outcome.FAILED if missed or is_cut else Outcome.PASSED,
        rates=rates,
        reason=f"missed: {', '.join(missed)}" if missed else "",
        criteria=criteria,
    )


def _press_once(cycle: Cycle, journal: Journal, findings: Findings) -> None:
    config, target_n = cycle.config, findings.record.force_target_n
    cycle.force_guard.contact = Contact.NONE
    journal.enter(Phase.HOME)
    move_to(cycle, home_pose(cycle), speed=config.robot.approach_speed)
    journal.enter(Phase.TARE)
    tare = take_quiet_tare(cycle)
    findings.record = replace(findings.record, tare_before=tare)
    if not all(criterion.passed for criterion in judge_tare(tare, config)):
        return
    cycle.force_guard.set_zero(tare)
    journal.enter(Phase.REFERENCE)
    cycle.rig.camera.ask(Look.REFERENCE)
    start_ns = cycle.rig.clock.now_ns()
    listen(cycle, config.protocol.reference_duration)
    end_ns = cycle.rig.clock.now_ns()
    findings.record = replace(findings.record, reference_start_ns=start_ns, reference_end_ns=end_ns)
    findings.reference_frame_count = cycle.rates.frame_count(start_ns, end_ns)
    journal.enter(Phase.APPROACH)
    approach(cycle)
    journal.enter(
        Phase.SEARCH, witnesses=cycle.witness.present(), force_sign=config.robot.force_sign
    )
    cycle.rig.camera.ask(Look.TOUCH)
    contact_z_m = search_contact(cycle)
    cycle.rig.camera.ask(Look.NOTHING)
    findings.record = replace(findings.record, contact_z_m=contact_z_m)
    journal.enter(Phase.PRESS, contact_z_m=contact_z_m, force_target_n=target_n)
    drive = PressDrive(cycle, target_n=target_n, contact_z_m=contact_z_m)
    press_to_target(cycle, drive)
    findings.settled = settle(cycle, drive)
    journal.enter(Phase.DWELL, force_n=cycle.last_force_n)
    held = hold(cycle, drive)
    force, cycle.contact_z_m = held.force, contact_z_m
    cycle.witness.remember_press()
    findings.record = replace(
        findings.record,
        force_measured_n=force.mean_n,
        force_deviation_n=force.deviation_n,
        force_rate_n_s=force.slope_n_s,
        depth_measured_m=held.depth_m,
        arm_force_n=held.arm_force_n,
        force_expected_n=held.expected_n,
        dwell_start_ns=force.start_ns,
        dwell_end_ns=force.end_ns,
    )
    findings.dwell_frame_count = cycle.rates.frame_count(force.start_ns, force.end_ns)
    findings.repeated_frame_count = cycle.rates.repeated_frame_count(
        (start_ns, end_ns), (force.start_ns, force.end_ns)
    )
    if config.protocol.sway > 0.0:
        journal.enter(Phase.SWAY)
        sway(cycle, drive)
    journal.enter(Phase.RETRACT, force_mean_n=force.mean_n)
    retract(cycle, contact_z_m=contact_z_m)
    journal.enter(Phase.DRIFT_CHECK)
    tare_after = take_tare(cycle)
    drift_n = force_drift(tare, tare_after, config=config)
    findings.record = replace(findings.record, tare_after=tare_after, force_drift_n=drift_n)


def _record_fault(
    cycle: Cycle, journal: Journal, findings: Findings, error: RigError
) -> TrialRecord:
    reaction = reaction_to(error)
    phase, force_n = journal.phase, cycle.last_force_n
    journal.phase = Phase.FAULT  # what is shown meanwhile; written once the arm is safe
    end = make_safe(cycle, reaction)
    outcome = Outcome.ABORTED if isinstance(error, AbortedError) else Outcome.FAULT
    journal.enter(Phase.FAULT)
    journal.write(
        "abort" if isinstance(error, AbortedError) else "fault",
        limit=error.limit if isinstance(error, BreachError) else "",
        reason=error.message,
        during=phase.value,
        reaction=reaction.value,
        force_n=force_n,
        peak_force_n=end.peak_force_n,
        stop_ms=end.stop_ms,
        position_m=list(end.pose.position) if end.pose else None,
        arm=end.text,
    )
    error.message = (
        f"{error.message} during {phase.value} of trial {findings.record.index}. {end.text}"
    )
    rates = cycle.rates.report()
    return replace(findings.record, outcome=outcome, rates=rates, reason=error.message)


def _finish(cycle: Cycle, journal: Journal, record: TrialRecord) -> None:
    journal.write(
        "attempt-end",
        outcome=record.outcome.value,
        reason=record.reason,
        force_measured_n=record.force_measured_n,
        depth_measured_m=record.depth_measured_m,
    )
    try:
        cycle.sink.put(End(record, cycle.rig.clock.now_ns()))
    except RecordError as error:
        # The fault that the lost record is has been raised where it was seen first.
        logger.error("the result of the attempt could not be kept: %s", error)
