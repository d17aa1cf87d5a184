"""Results of attempts whose control process did not live to write one."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from tacauchy_rig.errors import RecordError
from tacauchy_rig.run import JournalEvent, Outcome, TrialRecord
from tacauchy_rig.store.run_store import RunStore

logger = logging.getLogger(__name__)


def complete_results(store: RunStore, begun: Sequence[JournalEvent], *, reason: str) -> None:
    """Mark each attempt that has no result as a fault, for ``reason``.

    Args:
        store: The run's folder.
        begun: The ``attempt-start`` events of this session.
        reason: What cut the attempt off.
    """
    for event in begun:
        if store.load_result(event.trial, event.attempt) is not None:
            continue
        record = TrialRecord(
            index=event.trial,
            attempt=event.attempt,
            outcome=Outcome.FAULT,
            force_target_n=float(event.detail["force_target_n"]),
            reason=reason,
        )
        try:
            store.save_result(record)
        except RecordError as error:
            logger.error("%s", error)


def last_results(store: RunStore, begun: Sequence[JournalEvent]) -> tuple[TrialRecord, ...]:
    """Return the result of the last attempt at each trial that was begun."""
    last = {event.trial: event.attempt for event in begun}
    loaded = (store.load_result(trial, attempt) for trial, attempt in last.items())
    return tuple(record for record in loaded if record is not None)
