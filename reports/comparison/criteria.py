"""What a trial must meet, with the remedy when it does not."""

from __future__ import annotations

from reports.evidence.evidence import TrialEvidence
from tacauchy_rig.run import Criterion

NOT_THERE = "press and replay this trial first: `tacauchy-rig resume RUN`, then `replay RUN`"


def judge_record(trial: TrialEvidence) -> tuple[Criterion, ...]:
    """Return what protocol, recording and hashes say of a trial; what is missing fails."""
    return (_protocol(trial), *trial.checks)


def _protocol(trial: TrialEvidence) -> Criterion:
    record = trial.record
    if record is None:
        remedy = "`tacauchy-rig resume RUN` goes on with the first trial that is missing"
    else:
        failed = [c for c in record.criteria if not c.passed]
        remedy = (
            " ".join([record.reason, *(f"{c.name}: {c.remedy or c.limit}" for c in failed)]).strip()
            or "`tacauchy-rig resume RUN` repeats the trial"
        )
    passed = record is not None and record.passed
    limit = "the attempt ran to its end and met every check of the protocol"
    return Criterion.judged(
        "press", float(passed), passed=passed, limit=limit, unit="", remedy=remedy
    )
