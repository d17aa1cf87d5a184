"""Journal, description and replays of a run against themselves, their hashes and each other."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from typing import Any

from tacauchy_rig.core.config.load import hash_of_values
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import Criterion
from tacauchy_rig.core.simulated import Replay
from tacauchy_rig.core.store.check.attempt import Attempt
from tacauchy_rig.core.store.check.consistency import consistency, hash_mismatch, short_hash
from tacauchy_rig.core.store.codec import to_json
from tacauchy_rig.core.store.durable import bytes_sha256
from tacauchy_rig.core.store.journal import Journal, JournalLine, StoreEvent
from tacauchy_rig.core.store.run_files import is_inside
from tacauchy_rig.core.store.run_store import RunStore

_JOURNAL_REMEDY = (
    "journal.jsonl was edited or damaged after it was written: nothing puts that right. "
    "Restore it from a copy, or record a new run"
)
_DESCRIPTION_REMEDY = (
    "what the run is was edited after it was recorded: restore run.json and rig.toml from a copy, "
    "or record a new run"
)


def judge_run(
    store: RunStore, journal: Journal, attempts: Sequence[Attempt]
) -> Iterator[Criterion]:
    """Yield what holds of the run as a whole: description, journal, folders and replays."""
    yield consistency(
        "run_description",
        "run.json and the files beside it are unchanged since the run was recorded",
        _changed_description(store, journal),
        remedy=_DESCRIPTION_REMEDY,
    )
    yield from _judge_journal(journal, was_begun=bool(attempts))
    yield consistency(
        "journal_attempts",
        "every attempt that journal.jsonl tells of has its folder, and the other way round",
        _unmatched_attempts(journal, attempts),
    )
    logged = {str(event.detail.get("name")) for event in journal.store_events(StoreEvent.REPLAYED)}
    names = logged | {path.name for path in store.paths.replays.glob("*") if path.is_dir()}
    if names:
        yield consistency(
            "replay_files",
            "simulated forces and images are those that were made from these recordings",
            [line for name in sorted(names) for line in _changed_replay(store, name, journal)],
            remedy="`tacauchy-rig replay RUN` makes forces and images again from what was recorded",
        )


def _unmatched_attempts(journal: Journal, attempts: Sequence[Attempt]) -> Iterator[str]:
    names = ("attempt-start", StoreEvent.SEALED)
    logged = {(e.trial, e.attempt) for e in journal.events if e.name in names}
    for trial, attempt in sorted(logged - {(each.trial, each.attempt) for each in attempts}):
        yield f"attempt {attempt} at trial {trial} is in journal.jsonl and has no folder"
    for each in attempts:
        has_result = each.record is not None or each.unreadable
        if has_result and (each.trial, each.attempt) not in logged:
            yield f"{each.name} is unknown to journal.jsonl"


def _judge_journal(journal: Journal, *, was_begun: bool) -> Iterator[Criterion]:
    """Yield what holds of a journal whatever else is in the run, which may have attempts."""
    gone = ["journal.jsonl is missing"] if was_begun and not journal.exists else []
    yield consistency(
        "journal_chain",
        "each line of journal.jsonl has its number and the hash of the line before it",
        [*gone, *_broken_links(journal.lines), *_doubles(journal.lines)],
        remedy=_JOURNAL_REMEDY,
    )
    ending = "its last session has no run-end: the program was cut off, or lines were taken off"
    yield consistency(
        "journal_end",
        "journal.jsonl tells how every session ended",
        [ending] if journal.is_open else [],
        remedy="if the program was cut off, `tacauchy-rig recover RUN` notes that in the journal",
    )


def _broken_links(lines: Sequence[JournalLine]) -> Iterator[str]:
    before = ""
    for place, line in enumerate(lines, start=1):
        where = f"journal.jsonl line {place}"
        if line.event is None:  # half a line: the next whole one holds the hash of the last half
            following = lines[place] if place < len(lines) else line
            if following.event and following.previous != bytes_sha256(line.raw):
                yield f"{where} is no event, and the next line tells of another one"
        elif line.number != place:
            yield f"{where} ({line.event.name}) is numbered {line.number!r}"
        elif line.previous != before:
            yield (
                f"{where} ({line.event.name}) follows a line with the hash "
                f"{short_hash(line.previous)}, the line before it has {short_hash(before)}"
            )
        before = bytes_sha256(line.raw)


def _doubles(lines: Sequence[JournalLine]) -> Iterator[str]:
    seen: dict[str, int] = {}
    for place, line in enumerate(lines, start=1):
        if line.event is None:
            continue
        first = seen.setdefault(json.dumps(to_json(line.event), sort_keys=True), place)
        if first != place:
            yield f"journal.jsonl line {place} ({line.event.name}) is line {first} again"


def _changed_description(store: RunStore, journal: Journal) -> Iterator[str]:
    described, stated = store.description, store.config_hash
    recorded = described.get("config")
    found = hash_of_values(recorded)
    if found != stated:
        hashes = short_hash(found), short_hash(stated)
        yield "run.json: config has the hash {}, config_hash says {}".format(*hashes)
    for field, kept, read in _differing(recorded, store.config.model_dump(mode="json")):
        yield f"run.json: config.{field} is {kept!r}, as written it reads {read!r}"
    answered = described["devices"].items()
    pretending = [name for name, device in answered if device.get("simulated")]
    if pretending and not store.simulated:
        yield f"run.json: simulated is false, but so is no {', '.join(pretending)}"
    for file in (store.truth, store.force_check, store.expected, store.optics):
        if damage := file.damage():
            yield damage
    try:
        _ = store.imported_trials
    except RecordError as error:
        yield error.message
    yield from _hashes(store, journal)


def _hashes(store: RunStore, journal: Journal) -> Iterator[str]:
    written = store.description.get("rig_toml_sha256")
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
    """Yield fields of a recorded configuration that read otherwise now."""
    if isinstance(kept, dict) and isinstance(read, dict):
        for name in kept.keys() & read.keys():
            where = f"{prefix}.{name}" if prefix else name
            yield from _differing(kept[name], read[name], where)
    elif kept != read:
        yield prefix, kept, read


def _changed_replay(store: RunStore, name: str, journal: Journal) -> Iterator[str]:
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
    else:
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
    for trial in replay.trials:
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
