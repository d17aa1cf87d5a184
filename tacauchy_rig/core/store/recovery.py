"""What a run that was cut off leaves behind, put in order and noted in its journal."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from tacauchy_rig.core.store.check.journal import JournalReading
from tacauchy_rig.core.store.check.run import RunCheck, check_run
from tacauchy_rig.core.store.recording.recover import RecoveryReport, recover_recordings
from tacauchy_rig.core.store.run_store import RunStore
from tacauchy_rig.core.store.seals import Seal, file_sha256, seal


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRecovery:
    """What became of a run.

    Attributes:
        recordings: One for each recording.
        was_cut_off: Its journal had no end, and now says so.
        check: What contradicts what else afterwards.
    """

    recordings: list[RecoveryReport]
    was_cut_off: bool
    check: RunCheck

    @property
    def is_whole(self) -> bool:
        """True where nothing stays lost and nothing contradicts anything."""
        return not any(report.problems for report in self.recordings) and self.check.passed


def recover_run(store: RunStore) -> RunRecovery:
    """Recover every recording of a run, close its journal, and check all of it.

    Raises:
        RecordError: Another program works on the run, or it cannot be written.
    """
    with store.lock():
        reports = recover_recordings(store.paths.root)
        for report in reports:
            if report.changed:
                _note(store, report)
        journal = JournalReading.of(store.paths.journal)
        if journal.is_open:
            for key in _unsealed(store, journal):
                store.seal_result(*key)
            seal(store.paths.journal, Seal.CUT_OFF, lines=len(journal.lines))
    return RunRecovery(recordings=reports, was_cut_off=journal.is_open, check=check_run(store))


def _note(store: RunStore, report: RecoveryReport) -> None:
    trial, attempt = next(
        key for key in store.paths.attempts() if store.paths.recording(*key) == report.path
    )
    original = report.original
    seal(
        store.paths.journal,
        Seal.RECOVERED,
        trial=trial,
        attempt=attempt,
        recording_sha256=file_sha256(report.path, what="the recording"),
        original_sha256=None if original is None else file_sha256(original, what="the original"),
        before=report.before,
        message_count=report.message_count,
        merged_count=report.merged_count,
    )


def _unsealed(store: RunStore, journal: JournalReading) -> Iterator[tuple[int, int]]:
    for trial, attempt in store.paths.attempts():
        has_result = store.paths.result(trial, attempt).exists()
        if has_result and not journal.seals(Seal.SEALED, trial=trial, attempt=attempt):
            yield trial, attempt
