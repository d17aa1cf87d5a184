"""Make a run and press it: every trial without a passed attempt is recorded."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence, Set
from dataclasses import asdict
from pathlib import Path

from protocols.guard.abort import AbortWatch
from protocols.processes.messages import PageOptions, ViewerOptions
from protocols.processes.supervisor import SessionResult, run_session
from tacauchy_rig.app.session.cell import require_bounded_force
from tacauchy_rig.app.session.expected import kept_expectation
from tacauchy_rig.core.config.load import Change, LoadedConfig
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.run import Criterion, JournalEvent, Outcome, TrialRecord
from tacauchy_rig.core.store.free_space import check_free_space
from tacauchy_rig.core.store.journal import append_event
from tacauchy_rig.core.store.run_store import RunStore
from tacauchy_rig.core.versions import versions

MISSED = "missed: "


def create_run(loaded: LoadedConfig, config_text: str) -> RunStore:
    """Make a run's folder in the configured output directory.

    Args:
        loaded: The configuration.
        config_text: Its file as it was written, kept in the folder.

    Raises:
        RecordError: The folder cannot be made, or has no room for the recordings.
    """
    config = loaded.config
    parent = Path(config.run.output_directory)
    check_free_space(parent, config)
    return RunStore.create(
        parent,
        loaded,
        config_text=config_text,
        simulated=config.has_emulated_devices,
        versions=versions(),
    )


def note_changes(store: RunStore, changes: Sequence[Change]) -> None:
    """Write into the journal what a run goes on with that it did not begin with.

    Raises:
        RecordError: Another program works on the run, or the journal cannot be written.
    """
    if not changes:
        return
    event = JournalEvent.now("resume-set", changes=[asdict(change) for change in changes])
    with store.lock():
        append_event(store.paths.journal, event)


def record_run(
    store: RunStore,
    config: RigConfig | None = None,
    *,
    on_event: Callable[[JournalEvent], None],
    again: Set[int] = frozenset(),
    page: PageOptions | None = None,
    viewers: Sequence[ViewerOptions] = (),
    keep_page: bool = False,
) -> SessionResult:
    """Press every trial without a passed attempt; Ctrl-C, SIGTERM and a lost terminal end it.

    A real arm moves. Nothing here asks whether it may. Arguments and errors are those of
    ``run_session``; a config of None is the run's own.

    Raises:
        ForceCheckError: The cell was found wrong, or has to be checked by a weight first.
    """
    require_bounded_force(store, config or store.config)
    expected = kept_expectation(store)
    with AbortWatch() as watch:
        return run_session(
            store,
            config or store.config,
            on_event=on_event,
            abort=watch.abort,
            expected=expected,
            again=again,
            page=page,
            viewers=viewers,
            keep_page=keep_page,
        )


def missed_lines(records: Sequence[TrialRecord]) -> Iterator[str]:
    """Yield a line for each criterion that the last attempt at a trial missed.

    It names the trial, the criterion, what was measured, what was asked, and what to do.
    """
    for record in records:
        if record.outcome is not Outcome.FAILED:
            continue
        tries = f", attempt {record.attempt}" if record.attempt > 1 else ""
        for criterion in record.criteria:
            if not criterion.passed:
                yield f"{MISSED}trial {record.index}{tries}: {_told(criterion)}"


def _told(criterion: Criterion) -> str:
    measured = f"{criterion.measured:.4g} {criterion.unit}".rstrip()
    text = f"{criterion.name} is {measured}, required: {criterion.limit}"
    return f"{text} -> {criterion.remedy}" if criterion.remedy else text
