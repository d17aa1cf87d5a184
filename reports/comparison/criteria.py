"""What a trial must meet, with the remedy when it does not."""

from __future__ import annotations

import math
from collections.abc import Iterator

from reports.evidence.evidence import TrialEvidence
from tacauchy_rig.core.run import Criterion, Outcome

MAX_SETTLED_CHANGE = 0.05
"""Of the contact's change. A force that drifts as fast as `protocol.dwell_force_rate` admits moves
by 0.06 N in a dwell, 5 % of the lightest press. Gels creep by 5 to 8 % in all, mostly before."""

NOT_THERE = "press and replay this trial first: `tacauchy-rig resume RUN`, then `replay RUN`"


def judge_record(trial: TrialEvidence) -> tuple[Criterion, ...]:
    """Return what protocol, recording and hashes say of a trial; what is missing fails."""
    return (_protocol(trial), *_settled_images(trial), *trial.checks)


def _settled_images(trial: TrialEvidence) -> Iterator[Criterion]:
    """Yield whether the pictures of the dwell show one pose; nothing where there are too few."""
    if trial.images is None or trial.images.settled_change is None:
        return
    yield Criterion.at_most(
        "settled_images",
        trial.images.settled_change,
        MAX_SETTLED_CHANGE,
        remedy="the pose was held and the pictures went on changing: the camera delivers old ones "
        "(end other programs, see `tacauchy-rig doctor`: camera), or its light changes",
    )


def _protocol(trial: TrialEvidence) -> Criterion:
    record = trial.record
    if record is not None and record.outcome is Outcome.IMPORTED:
        return Criterion(
            name="press",
            passed=False,
            measured=math.nan,
            limit="a protocol watched the press",
            unit="",
            remedy="nothing here can tell: the press was imported",
        )
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
