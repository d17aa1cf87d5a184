"""All checks of a run: what its report, its replay, ``recover`` and ``resume`` ask first."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from tacauchy_rig.errors import RecordError
from tacauchy_rig.run import Criterion, TrialRecord
from tacauchy_rig.store.check.attempt import Attempt, judge_events, judge_files
from tacauchy_rig.store.check.contradiction import TRIAL, agreement
from tacauchy_rig.store.check.description import judge_description
from tacauchy_rig.store.check.journal import JournalReading, judge_journal
from tacauchy_rig.store.check.press import judge_contact, judge_press
from tacauchy_rig.store.check.replay import judge_replays
from tacauchy_rig.store.check.streams import judge_streams
from tacauchy_rig.store.recording.reading import Recording
from tacauchy_rig.store.run_store import RunStore
from tacauchy_rig.store.seals import Seal


@dataclass(frozen=True, slots=True, kw_only=True)
class RunCheck:
    """What was checked, met or not.

    Attributes:
        run: Of the run as a whole.
        attempts: By trial and attempt.
        notes: What is no contradiction and should be known: sessions and attempts that were cut
            off, settings that were changed for a session, recordings that were repaired, and what
            was never sealed.
        journal_head: SHA-256 of the journal's last line. It stands for all that is sealed: written
            down elsewhere, it shows any later change.
    """

    run: tuple[Criterion, ...]
    attempts: dict[tuple[int, int], tuple[Criterion, ...]]
    notes: tuple[str, ...]
    journal_head: str

    @property
    def passed(self) -> bool:
        """True where nothing contradicts anything."""
        return not any(True for _ in self.missed())

    def missed(self) -> Iterator[str]:
        """Yield a line for each criterion that is not met: where, which, what, and what to do."""
        for criterion in self.run:
            if not criterion.passed:
                yield _told(criterion)
        for (trial, attempt), criteria in self.attempts.items():
            for criterion in criteria:
                if not criterion.passed:
                    yield f"trial {trial}, attempt {attempt}: {_told(criterion)}"


def check_run(store: RunStore) -> RunCheck:
    """Hold all that a run says of itself against its recordings, its journal and its hashes.

    Raises:
        RecordError: A result or the journal is no longer readable; the message names the file.
    """
    journal = JournalReading.of(store.paths.journal)
    results = {key: store.load_result(*key) for key in store.paths.attempts()}
    return RunCheck(
        run=tuple(_judge_run(store, journal, results)),
        attempts={
            (trial, number): tuple(
                replace(c, remedy=c.remedy.replace(TRIAL, str(trial)))
                for c in _judge_attempt(Attempt(store, journal, trial, number, record))
            )
            for (trial, number), record in results.items()
        },
        notes=tuple(_notes(store, journal, results)),
        journal_head=journal.head,
    )


def _judge_run(
    store: RunStore,
    journal: JournalReading,
    results: dict[tuple[int, int], TrialRecord | None],
) -> Iterator[Criterion]:
    yield judge_description(store, journal)
    if journal.is_sealed or "rig_toml_sha256" in store.description:
        yield from judge_journal(journal, was_begun=bool(results))
    yield agreement(
        "journal_attempts",
        "every attempt that journal.jsonl tells of has its folder, and the other way round",
        _strangers(journal, results),
    )
    yield from judge_replays(store, journal)


def _strangers(
    journal: JournalReading, results: dict[tuple[int, int], TrialRecord | None]
) -> Iterator[str]:
    told = {
        (e.trial, e.attempt) for e in journal.events if e.name in ("attempt-start", Seal.SEALED)
    }
    for trial, attempt in sorted(told - set(results)):
        yield f"attempt {attempt} at trial {trial} is in journal.jsonl and has no folder"
    for (trial, attempt), record in results.items():
        if record is not None and (trial, attempt) not in told:
            yield f"trials/{trial:02d}/attempt-{attempt} is unknown to journal.jsonl"


def _judge_attempt(attempt: Attempt) -> Iterator[Criterion]:
    yield from judge_files(attempt)
    record, recording = attempt.record, attempt.recording
    if not isinstance(recording, Recording):
        return
    try:
        yield judge_events(attempt, recording)
        if record is not None:
            yield from judge_streams(attempt, recording, record)
            yield from judge_press(attempt, record)
            yield from judge_contact(attempt, record)
    except (RecordError, ValueError, TypeError) as error:  # a message that no longer decodes
        yield agreement(
            "recording_decodes",
            "every message of the recording decodes",
            [f"{attempt.name}/recording.mcap: {error}"],
        )


def _notes(
    store: RunStore,
    journal: JournalReading,
    results: dict[tuple[int, int], TrialRecord | None],
) -> Iterator[str]:
    if not journal.is_sealed:
        yield (
            "This run was recorded without hashes, by an earlier version of the program: what was "
            "edited in it since can be found only where its files contradict each other."
        )
    if journal.was_cut:
        yield "A session of this run was cut off; what was on the disk then was kept."
    yield from _changed_settings(journal)
    for (trial, attempt), record in results.items():
        at = Attempt(store, journal, trial, attempt, record)
        for event in at.seals(Seal.RECOVERED):
            yield (
                f"The recording of trial {trial}, attempt {attempt} was repacked by recover: it "
                f"was {event.detail.get('before')}."
            )


def _changed_settings(journal: JournalReading) -> Iterator[str]:
    """Yield a sentence for each field that a session went on with changed."""
    since = "before the first attempt"
    for event in journal.events:
        if event.name == "attempt-start":
            since = f"after trial {event.trial}, attempt {event.attempt}"
        elif event.name == "resume-set":
            for change in event.detail.get("changes", ()):
                old = change.get("old") or "nothing"
                yield (
                    f"`resume --set` changed {change.get('field')} from {old} to "
                    f"{change.get('new')} for one session, {since}."
                )


def _told(criterion: Criterion) -> str:
    measured = f"{criterion.measured:.6g} {criterion.unit}".rstrip()
    return f"{criterion.name}: {measured}, asked: {criterion.limit} -> {criterion.remedy}"
