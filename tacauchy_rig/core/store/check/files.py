"""Journal, description and replays of a run against themselves, their hashes and each other."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import Criterion, JournalEvent
from tacauchy_rig.core.simulated import Replay
from tacauchy_rig.core.store.codec import to_json
from tacauchy_rig.core.store.journal import JournalLine, StoreEvent, line_hash, read_lines
from tacauchy_rig.core.store.run_files import file_sha256, is_inside
from tacauchy_rig.core.store.run_store import RunStore

TRIAL = "TRIAL"
"""In a remedy, where the trial's number goes."""

SET_ASIDE = (
    "the file was edited, exchanged or damaged after it was written. "
    f"`tacauchy-rig resume RUN --again {TRIAL}` presses the trial once more"
)
_WRITTEN_OUT = 3
"""Contradictions that are written out; one edit often breaks many lines."""
_SHOWN_HASH = 12
"""Digits of a hash that are written out: 48 bits, and the file has the rest."""


def consistency(
    name: str, condition: str, contradictions: Iterable[str], *, remedy: str = SET_ASIDE
) -> Criterion:
    """Return a criterion that is met where nothing contradicts a promise.

    Args:
        name: Of the criterion, such as ``recording_hash``.
        promise: What has to hold, in words.
        contradictions: Each names the file and both values.
        remedy: What to do where it does not hold.
    """
    found = list(contradictions)
    logged = "; ".join(found[:_WRITTEN_OUT])
    more = f"; and {len(found) - _WRITTEN_OUT} more" if len(found) > _WRITTEN_OUT else ""
    return Criterion(
        name=name,
        passed=not found,
        measured=float(len(found)),
        limit=f"{condition}; but {logged}{more}" if found else condition,
        unit="wrong",
        remedy=remedy if found else "",
    )


def hash_mismatch(folder: Path, file: str, *known: object, name: str = "") -> Iterator[str]:
    """Yield that a file is missing, or is none of those that are known.

    Args:
        folder: Where it lies; what leads out of it is not read.
        file: The file within it.
        known: SHA-256 that it may have, the newest last.
        name: What it is called; left out, its own name.
    """
    path = folder / file
    if not is_inside(file):
        yield f"{file!r} is no name of a file of the run"
        return
    if not path.is_file():
        yield f"{name or path.name} is missing"
        return
    found = file_sha256(path, what="a file of the run")
    if found not in known:
        now, before = short_hash(found), short_hash(known[-1])
        yield f"{name or path.name} has the sha256 {now}, and had {before}"


def short_hash(sha256: object) -> str:
    """Return a hash as it is written out."""
    return str(sha256 or "none")[:_SHOWN_HASH]


START, END = "run-start", "run-end"

_JOURNAL_REMEDY = (
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
    def has_hashes(self) -> bool:
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
        return StoreEvent.CUT_OFF in self._ends or (START, START) in pairwise(self._ends)

    @property
    def may_lack_hashes(self) -> bool:
        """True where a crash may have come between a result and the line about it."""
        return self.is_open or self.was_cut

    @cached_property
    def _ends(self) -> list[str]:
        """Names of the events that begin or end a session."""
        names = (START, END, StoreEvent.CUT_OFF)
        return [e.name for e in self.events if e.name in names and not e.trial]

    def store_events(
        self, name: StoreEvent, *, trial: int = 0, attempt: int = 0
    ) -> list[JournalEvent]:
        """Return the events of a kind about an attempt, or about the whole run."""
        wanted = (name, trial, attempt)
        return [e for e in self.events if (e.name, e.trial, e.attempt) == wanted]

    def of_attempt(self, trial: int, attempt: int) -> list[JournalEvent]:
        """Return what the protocol wrote of an attempt."""
        own = [e for e in self.events if (e.trial, e.attempt) == (trial, attempt)]
        return [e for e in own if e.name not in set(StoreEvent)]


def judge_journal(journal: JournalReading, *, was_begun: bool) -> Iterator[Criterion]:
    """Yield what holds of a sealed journal whatever else is in the run.

    Args:
        journal: The journal.
        was_begun: The run has attempts.
    """
    gone = ["journal.jsonl is missing"] if was_begun and not journal.exists else []
    yield consistency(
        "journal_chain",
        "each line of journal.jsonl has its number and the hash of the line before it",
        [*gone, *_broken_links(journal.lines), *_doubles(journal.lines)],
        remedy=_JOURNAL_REMEDY,
    )
    ending = (
        ["its last session has no run-end: the program was cut off, or lines were taken off"]
        if journal.is_open
        else []
    )
    yield consistency(
        "journal_end",
        "journal.jsonl tells how every session ended",
        ending,
        remedy="if the program was cut off, `tacauchy-rig recover RUN` notes that in the journal",
    )


def _broken_links(lines: Sequence[JournalLine]) -> Iterator[str]:
    before = ""
    for place, line in enumerate(lines, start=1):
        where = f"journal.jsonl line {place}"
        if line.event is None:  # half a line: the next whole one holds the hash of the last half
            following = lines[place] if place < len(lines) else line
            if following.event and following.previous != line_hash(line.raw):
                yield f"{where} is no event, and the next line tells of another one"
        elif line.number is None or line.previous is None:
            yield f"{where} ({line.event.name}) has no number"
        elif line.number != place:
            yield f"{where} ({line.event.name}) is numbered {line.number}"
        elif line.previous != before:
            yield (
                f"{where} ({line.event.name}) follows a line with the hash "
                f"{short_hash(line.previous)}, the line before it has {short_hash(before)}"
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


_DESCRIPTION_REMEDY = (
    "what the run is was edited after it was recorded: restore run.json and rig.toml from a copy, "
    "or record a new run"
)


def judge_description(store: RunStore, journal: JournalReading) -> Criterion:
    """Say whether ``run.json`` still is what the run was recorded with."""
    return consistency(
        "run_description",
        "run.json and what lies beside it are as they were when the run was recorded",
        _changed_description(store, journal),
        remedy=_DESCRIPTION_REMEDY,
    )


def _changed_description(store: RunStore, journal: JournalReading) -> Iterator[str]:
    described, stated = store.description, store.config_hash
    recorded = described.get("config")
    found = hashlib.sha256(json.dumps(recorded, sort_keys=True).encode()).hexdigest()
    if found != stated:
        hashes = short_hash(found), short_hash(stated)
        yield "run.json: config has the hash {}, config_hash says {}".format(*hashes)
    for field, kept, read in _differing(recorded, store.config.model_dump(mode="json")):
        yield f"run.json: config.{field} is {kept!r}, as written it reads {read!r}"
    answered = described["devices"].items()
    pretending = [name for name, device in answered if device.get("simulated")]
    if pretending and not store.simulated:
        yield f"run.json: simulated is false, but so is no {', '.join(pretending)}"
    for load in (
        store.truth.load,
        store.force_check.load,
        store.expected.load,
        store.optics.load,
        lambda: store.imported_trials,
    ):
        try:
            load()
        except RecordError as error:
            yield error.message
    yield from _hashes(store, journal)


def _hashes(store: RunStore, journal: JournalReading) -> Iterator[str]:
    written = store.description.get("rig_toml_sha256")
    if written is not None:
        yield from hash_mismatch(store.paths.root, store.paths.rig_toml.name, written)
    sealed = journal.store_events(StoreEvent.WRITTEN)
    for name in dict.fromkeys(str(event.detail.get("file")) for event in sealed):
        logged = [event for event in sealed if event.detail.get("file") == name]
        known = [event.detail.get("sha256") for event in logged]
        # The line goes out before the file: where it is the journal's last, a crash may have left
        # the file that the line before tells of, or none.
        if known[-1] is None:
            if not journal.was_cut:
                yield f"{name} could not be read and was set aside"
            continue
        may_be_older = journal.events[-1] is logged[-1]
        if not may_be_older or len(logged) > 1:
            yield from hash_mismatch(store.paths.root, name, *known[-2 if may_be_older else -1 :])


def _differing(kept: Any, read: Any, prefix: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield fields of a recorded configuration that read otherwise now.

    A field that only one version of the program knows says nothing.
    """
    if isinstance(kept, dict) and isinstance(read, dict):
        for name in kept.keys() & read.keys():
            where = f"{prefix}.{name}" if prefix else name
            yield from _differing(kept[name], read[name], where)
    elif kept != read:
        yield prefix, kept, read


_REPLAY_REMEDY = "`tacauchy-rig replay RUN` makes forces and images again from what was recorded"


def judge_replays(store: RunStore, journal: JournalReading) -> Iterator[Criterion]:
    """Yield, for a run that was replayed, whether its simulated forces and images are its own."""
    there = {path.name for path in store.paths.replays.glob("*") if path.is_dir()}
    logged = {str(event.detail.get("name")) for event in journal.store_events(StoreEvent.REPLAYED)}
    names = sorted(there | logged)
    if names:
        yield consistency(
            "replay_files",
            "simulated forces and images are those that were made from these recordings",
            [line for name in names for line in _changed_replay(store, name, journal)],
            remedy=_REPLAY_REMEDY,
        )


def _changed_replay(store: RunStore, name: str, journal: JournalReading) -> Iterator[str]:
    if not is_inside(name):
        yield f"journal.jsonl tells of a replay {name!r}, which is no name of a folder"
        return
    path = store.paths.replay_json(name)
    logged = [e for e in journal.store_events(StoreEvent.REPLAYED) if e.detail.get("name") == name]
    if not path.exists():
        if logged:
            yield f"replay/{name}/replay.json is missing; journal.jsonl says that it was made"
        return
    try:
        replay = store.load_replay(name)
    except RecordError as error:
        yield error.message
        return
    if logged:
        known = logged[-1].detail.get("replay_sha256")
        yield from hash_mismatch(path.parent, path.name, known, name=f"replay/{name}/replay.json")
    elif replay.made_from or "rig_toml_sha256" in store.description:
        yield f"replay/{name} is unknown to journal.jsonl"
    yield from _source_mismatches(store, name, replay)
    yield from _file_mismatches(store, name, replay)
    yield from _force_mismatches(store, name, replay)


def _source_mismatches(store: RunStore, name: str, replay: Replay) -> Iterator[str]:
    for file, known in replay.made_from.items():
        if file != "config":
            yield from hash_mismatch(store.paths.root, file, known, name=file)
        elif known != store.config_hash:
            yield (
                f"replay/{name} was made with the configuration {short_hash(known)}, the run's is "
                f"{short_hash(store.config_hash)}"
            )


def _file_mismatches(store: RunStore, name: str, replay: Replay) -> Iterator[str]:
    folder = store.paths.replays / name
    for file, known in replay.files.items():
        yield from hash_mismatch(folder, file, known, name=f"replay/{name}/{file}")
    for trial in replay.trials if replay.files else ():
        for path in sorted(store.paths.replay_trial(name, trial.index).glob("*")):
            if str(path.relative_to(folder)) not in replay.files:
                yield f"replay/{name}: {path.relative_to(folder)} was not made by this replay"


def _force_mismatches(store: RunStore, name: str, replay: Replay) -> Iterator[str]:
    """Yield trials that were replayed to another force than was measured."""
    for trial in replay.trials:
        record = store.counting(trial.index)
        measured_n = None if record is None else record.force_measured_n
        pressed_n = None if math.isnan(trial.force_measured_n) else trial.force_measured_n
        if pressed_n != measured_n:
            yield (
                f"replay/{name} pressed trial {trial.index} to {pressed_n!r} N, "
                f"result.json says {measured_n!r} N"
            )
