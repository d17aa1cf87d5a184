"""A viewer from outside, the twin: what its death costs a run."""

from __future__ import annotations

import os
import signal
import threading

import pytest

from protocols.guard.abort import Abort
from protocols.processes.supervisor import run_session
from tacauchy_rig.app.twin.twin import Follows, twin_options
from tacauchy_rig.core.run import Outcome
from tacauchy_rig.core.store.check.run import check_run
from tacauchy_rig.core.store.recording.reading import Recording


@pytest.mark.slow
def test_a_run_loses_nothing_when_its_twin_is_killed(make_store):
    """Killed in the middle of a press: the run passes, every sample is recorded."""
    store, pids = make_store('protocol.force_targets=["1.2 N", "1.5 N"]'), {}

    def on_event(event):
        pids.update(event.detail["pids"] if event.name == "run-start" else {})
        if event.name == "phase" and event.detail["phase"] == "press" and event.trial == 2:
            threading.Timer(0.3, os.kill, [pids["twin"], signal.SIGKILL]).start()

    result = run_session(
        store,
        store.config,
        on_event=on_event,
        abort=Abort(),
        viewers=[twin_options(Follows.FORCE)],
    )
    assert (result.outcome, result.died) == (Outcome.PASSED, {})
    recordings = [Recording.open(store.paths.recording(trial, 1)) for trial in (1, 2)]
    assert sum(result.acknowledged.values()) == sum(each.message_count for each in recordings)
    for recording in recordings:
        counters = recording.force().counter.tolist()
        assert counters == list(range(counters[0], counters[-1] + 1))
    assert list(check_run(store).missed()) == []
