"""The journal against itself: numbers, chain, doubles, and sessions that ended."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

from tacauchy_rig.core.run import Criterion, JournalEvent
from tacauchy_rig.core.store.check.contradiction import agreement, shown
from tacauchy_rig.core.store.codec import to_json
from tacauchy_rig.core.store.journal import JournalLine, line_hash, read_lines
from tacauchy_rig.core.store.seals import Seal

START, END = "run-start", "run-end"

_REMEDY = (
    "journal.jsonl was edited or damaged after it was written: nothing puts that right. "
    "Restore it from a copy, or record a new run"
)


@dataclass(frozen=True)
class JournalReading:
    """A run's journal.

    Attributes:
        lines: As they stand in the file; empty where it has none.
        exists: False where the file is missing.
    """

    lines: Sequence[JournalLine]
    exists: bool = True

    @classmethod
    def of(cls, path: Path) -> JournalReading:
        """Read a journal, which a run that never began does not have.

        Raises:
            RecordError: Unreadable, or a line of it is no event.
        """
        return cls(read_lines(path)) if path.exists() else cls((), exists=False)

    @cached_property
    def events(self) -> list[JournalEvent]:
        """Every whole line."""
        return [line.event for line in self.lines if line.event is not None]

    @property
    def is_sealed(self) -> bool:
        """False for a journal without numbers, as an earlier version of the program wrote it."""
        return any(line.number is not None for line in self.lines)

    @property
    def head(self) -> str:
        """SHA-256 of the last line, which stands for the whole run; empty without a journal."""
        return line_hash(self.lines[-1].raw) if self.lines else ""

    @property
    def is_open(self) -> bool:
        """True where the last session has no end: it runs, or was cut off."""
        return self._ends[-1:] == [START]

    @property
    def was_cut(self) -> bool:
        """True where a session was cut off, said or not."""
        return Seal.CUT_OFF in self._ends or (START, START) in pairwise(self._ends)

    @property
    def may_lack_a_seal(self) -> bool:
        """True where a crash may have come between a result and the line about it."""
        return self.is_open or self.was_cut

    @cached_property
    def _ends(self) -> list[str]:
        """Names of the events that begin or end a session."""
        return [e.name for e in self.events if e.name in (START, END, Seal.CUT_OFF)]

    def seals(self, name: Seal, *, trial: int = 0, attempt: int = 0) -> list[JournalEvent]:
        """Return the events of a kind that tell of an attempt, or of the whole run."""
        wanted = (name, trial, attempt)
        return [e for e in self.events if (e.name, e.trial, e.attempt) == wanted]

    def of_attempt(self, trial: int, attempt: int) -> list[JournalEvent]:
        """Return what the protocol wrote of an attempt."""
        own = [e for e in self.events if (e.trial, e.attempt) == (trial, attempt)]
        return [e for e in own if e.name not in set(Seal)]


def judge_journal(journal: JournalReading, *, was_begun: bool) -> Iterator[Criterion]:
    """Yield what holds of a sealed journal whatever else is in the run.

    Args:
        journal: The journal.
        was_begun: The run has attempts.
    """
    gone = ["journal.jsonl is missing"] if was_begun and not journal.exists else []
    yield agreement(
        "journal_chain",
        "each line of journal.jsonl has its number and the hash of the line before it",
        [*gone, *_broken_links(journal.lines), *_doubles(journal.lines)],
        remedy=_REMEDY,
    )
    ending = (
        ["its last session has no run-end: the program was cut off, or lines were taken off"]
        if journal.is_open
        else []
    )
    yield agreement(
        "journal_end",
        "journal.jsonl tells how every session ended",
        ending,
        remedy="if the program was cut off, `tacauchy-rig recover RUN` notes that in the journal",
    )


def _broken_links(lines: Sequence[JournalLine]) -> Iterator[str]:
    before = ""
    for place, line in enumerate(lines, start=1):
        where = f"journal.jsonl line {place}"
        if line.event is None:  # half a line: what follows it holds its hash
            if place < len(lines) and lines[place].previous != line_hash(line.raw):
                yield f"{where} is no event, and the next line tells of another one"
        elif line.number is None or line.previous is None:
            yield f"{where} ({line.event.name}) has no number"
        elif line.number != place:
            yield f"{where} ({line.event.name}) is numbered {line.number}"
        elif line.previous != before:
            yield (
                f"{where} ({line.event.name}) follows a line with the hash "
                f"{shown(line.previous)}, the line before it has {shown(before)}"
            )
        before = line_hash(line.raw)


def _doubles(lines: Sequence[JournalLine]) -> Iterator[str]:
    seen: dict[str, int] = {}
    for place, line in enumerate(lines, start=1):
        if line.event is None:
            continue
        first = seen.setdefault(json.dumps(to_json(line.event), sort_keys=True), place)
        if first != place:
            yield f"journal.jsonl line {place} ({line.event.name}) is line {first} again"
