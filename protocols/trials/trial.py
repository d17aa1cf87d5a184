"""One attempt at a trial, from home to home."""

from __future__ import annotations

import logging
from dataclasses import dataclass

from protocols.control.cycle import Cycle
from protocols.control.journal import Journal
from protocols.control.rates import RateMeter
from protocols.control.record import Begin, End
from protocols.control.window import take_reference
from protocols.guard.breach import BreachError, reaction_to
from protocols.guard.force import Contact
from protocols.steps.make_safe import make_safe
from protocols.steps.motion import approach, home_pose, move_to, retract
from protocols.steps.press import PressDrive, hold, press_to_target, settle
from protocols.steps.search import search_contact
from protocols.steps.tare import force_drift, judge_tare, take_quiet_tare, take_tare
from protocols.trials.verdict import Findings, judge
from tacauchy_rig.errors import AbortedError, RecordError, RigError
from tacauchy_rig.run import Outcome, Phase, TrialRecord, TrialSpec

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialEnd:
    """How an attempt ended.

    Attributes:
        error: What cut it off (a breach, an abort or a refusal), after the arm was made safe;
            None where it ran to its end.
    """

    record: TrialRecord
    error: RigError | None = None


def run_trial(cycle: Cycle, journal: Journal, spec: TrialSpec, *, attempt: int) -> TrialEnd:
    """Run one attempt; its record is kept whatever happens."""
    findings = Findings(spec=spec, attempt=attempt)
    journal.trial, journal.attempt = spec.index, attempt
    cycle.rates = RateMeter()
    error: RigError | None = None
    try:
        cycle.sink.put(Begin(spec.index, attempt))
        journal.write("attempt-start", force_target_n=spec.force_target_n)
        _press_once(cycle, journal, findings)
        record = _judge(cycle, journal, findings)
    except RigError as problem:
        error = problem
        record = _record_fault(cycle, journal, findings, problem)
    _finish(cycle, journal, record)
    return TrialEnd(record=record, error=error)


def _judge(cycle: Cycle, journal: Journal, findings: Findings) -> TrialRecord:
    journal.enter(Phase.VERDICT)
    rates = cycle.rates.report()
    criteria = judge(findings, cycle.config, rates)
    missed = [criterion.name for criterion in criteria if not criterion.passed]
    return findings.record(
        Outcome.FAILED if missed or findings.dwell is None else Outcome.PASSED,
        rates=rates,
        reason=f"missed: {', '.join(missed)}" if missed else "",
        criteria=criteria,
    )


def _press_once(cycle: Cycle, journal: Journal, findings: Findings) -> None:
    config, target_n = cycle.config, findings.spec.force_target_n
    cycle.force_guard.contact = Contact.NONE
    journal.enter(Phase.HOME)
    move_to(cycle, home_pose(cycle), speed=config.robot.approach_speed)
    journal.enter(Phase.TARE)
    findings.tare_before = take_quiet_tare(cycle)
    if not all(criterion.passed for criterion in judge_tare(findings.tare_before, config)):
        return
    cycle.force_guard.set_zero(findings.tare_before)
    journal.enter(Phase.REFERENCE)
    findings.reference = take_reference(cycle)
    journal.enter(Phase.APPROACH)
    approach(cycle)
    journal.enter(Phase.SEARCH)
    findings.contact_z_m = search_contact(cycle)
    journal.enter(Phase.PRESS, contact_z_m=findings.contact_z_m, force_target_n=target_n)
    drive = PressDrive(cycle, target_n=target_n, contact_z_m=findings.contact_z_m)
    press_to_target(cycle, drive)
    settled = settle(cycle, drive)
    journal.enter(Phase.DWELL, force_n=cycle.last_force_n)
    findings.dwell = hold(cycle, drive, settled=settled)
    journal.enter(Phase.RETRACT, force_mean_n=findings.dwell.force.mean_n)
    retract(cycle, contact_z_m=findings.contact_z_m)
    journal.enter(Phase.DRIFT_CHECK)
    findings.tare_after = take_tare(cycle)
    findings.drift_n = force_drift(findings.tare_before, findings.tare_after, config=config)


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
        f"{error.message} during {phase.value} of trial {findings.spec.index}. {end.text}"
    )
    return findings.record(outcome, rates=cycle.rates.report(), reason=error.message)


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
