"""All checks of a run: what its report, its replay, ``recover`` and ``resume`` ask first."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import Criterion
from tacauchy_rig.core.store.check.attempt import Attempt, judge_events, judge_files, judge_streams
from tacauchy_rig.core.store.check.consistency import TRIAL, consistency
from tacauchy_rig.core.store.check.files import judge_run
from tacauchy_rig.core.store.check.press import judge_contact, judge_press
from tacauchy_rig.core.store.journal import Journal
from tacauchy_rig.core.store.run_store import RunStore


@dataclass(frozen=True, slots=True, kw_only=True)
class RunCheck:
    """What was checked, met or not."""

    run: tuple[Criterion, ...]  # of the run as a whole
    attempts: dict[tuple[int, int], tuple[Criterion, ...]]  # by trial and attempt
    # What is no contradiction and should be known: sessions and attempts that were cut off,
    # settings that were changed for a session, and recordings that were repaired
    notes: tuple[str, ...]
    # SHA-256 of the journal's last line. It stands for all that is sealed: written down elsewhere,
    # it shows any later change.
    journal_head: str

    @property
    def passed(self) -> bool:
        """True where nothing contradicts anything."""
        return not any(self._missed())

    def missed(self) -> Iterator[str]:
        """Yield a line for each criterion that is not met: where, which, what, and what to do."""
        return (f"{where}{_line(criterion)}" for where, criterion in self._missed())

    def missed_names(self) -> tuple[str, ...]:
        """Return the names of the criteria that are not met, each once."""
        return tuple(dict.fromkeys(criterion.name for _, criterion in self._missed()))

    def _missed(self) -> Iterator[tuple[str, Criterion]]:
        places = [("", self.run)]
        places += [(f"trial {t}, attempt {a}: ", each) for (t, a), each in self.attempts.items()]
        return ((where, c) for where, each in places for c in each if not c.passed)


def check_run(store: RunStore) -> RunCheck:
    """Hold all that a run says of itself against its recordings, its journal and its hashes.

    Raises:
        RecordError: The journal is no longer readable; the message names the line.
    """
    journal = Journal.read(store.paths.journal)
    attempts = [Attempt(store, journal, *key) for key in store.paths.attempts()]
    return RunCheck(
        run=tuple(judge_run(store, journal, attempts)),
        attempts={(each.trial, each.attempt): tuple(_judge_attempt(each)) for each in attempts},
        notes=tuple(_notes(journal, attempts)),
        journal_head=journal.head,
    )


def _judge_attempt(attempt: Attempt) -> Iterator[Criterion]:
    for criterion in (*judge_files(attempt), *_judge_content(attempt)):
        remedy = criterion.remedy.replace(TRIAL, str(attempt.trial))
        yield replace(criterion, remedy=remedy)


def _judge_content(attempt: Attempt) -> Iterator[Criterion]:
    record, recording = attempt.record, attempt.recording
    if recording is None:
        return
    try:
        yield judge_events(attempt, recording)
        if record is not None:
            yield from judge_streams(attempt, recording, record)
            yield from judge_press(attempt, recording, record)
            yield from judge_contact(attempt, recording, record)
    # A message that no longer decodes, or a number that nothing can be compared with.
    except (RecordError, ValueError, TypeError, OverflowError) as error:
        yield consistency(
            "recording_decodes",
            "every message of the recording decodes",
            [f"{attempt.name}/recording.mcap: {error}"],
        )


def _notes(journal: Journal, attempts: Sequence[Attempt]) -> Iterator[str]:
    if journal.was_cut:
        yield "A session of this run was cut off; what was on the disk then was kept."
    yield from _changed_settings(journal)
    for each in attempts:
        for event in each.cut_off:
            yield (
                f"Attempt {each.attempt} at trial {each.trial} is unfinished: "
                f"{event.detail.get('why')}."
            )
        for event in each.repacked:
            yield (
                f"The recording of trial {each.trial}, attempt {each.attempt} was repacked by "
                f"recover: it was {event.detail.get('before')}."
            )


def _changed_settings(journal: Journal) -> Iterator[str]:
    """Yield a sentence for each field that a session went on with changed."""
    since = "before the first attempt"
    for event in journal.events:
        if event.name == "attempt-start":
            since = f"after trial {event.trial}, attempt {event.attempt}"
        elif event.name == "resume-set":
            changes = event.detail.get("changes")
            tables = changes if isinstance(changes, list) else []
            for change in (each for each in tables if isinstance(each, dict)):
                old = change.get("old") or "nothing"
                yield (
                    f"`resume --set` changed {change.get('field')} from {old} to "
                    f"{change.get('new')} for one session, {since}."
                )


def _line(criterion: Criterion) -> str:
    measured = f"{criterion.measured:.6g} {criterion.unit}".rstrip()
    return f"{criterion.name}: {measured}, required: {criterion.limit} -> {criterion.remedy}"
