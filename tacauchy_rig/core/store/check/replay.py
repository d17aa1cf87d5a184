"""Replays against what they were made from, and against their own files."""

from __future__ import annotations

import math
from collections.abc import Iterator

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import Criterion
from tacauchy_rig.core.simulated import Replay
from tacauchy_rig.core.store.check.contradiction import agreement, shown, unlike
from tacauchy_rig.core.store.check.journal import JournalReading
from tacauchy_rig.core.store.run_store import RunStore
from tacauchy_rig.core.store.seals import Seal

_REMEDY = "`tacauchy-rig replay RUN` makes forces and images again from what was recorded"


def judge_replays(store: RunStore, journal: JournalReading) -> Iterator[Criterion]:
    """Yield, for a run that was replayed, whether its simulated forces and images are its own."""
    there = {path.name for path in store.paths.replays.glob("*") if path.is_dir()}
    told = {str(event.detail.get("name")) for event in journal.seals(Seal.REPLAYED)}
    names = sorted(there | told)
    if names:
        yield agreement(
            "replay_files",
            "simulated forces and images are those that were made from these recordings",
            [line for name in names for line in _contradictions(store, name, journal)],
            remedy=_REMEDY,
        )


def _contradictions(store: RunStore, name: str, journal: JournalReading) -> Iterator[str]:
    path = store.paths.replay_json(name)
    told = [e for e in journal.seals(Seal.REPLAYED) if e.detail.get("name") == name]
    if not path.exists():
        if told:
            yield f"replay/{name}/replay.json is missing; journal.jsonl says that it was made"
        return
    try:
        replay = store.load_replay(name)
    except RecordError as error:
        yield error.message
        return
    if told:
        known = told[-1].detail.get("replay_sha256")
        yield from unlike(path, known, name=f"replay/{name}/replay.json")
    elif replay.made_from or "rig_toml_sha256" in store.description:
        yield f"replay/{name} is unknown to journal.jsonl"
    yield from _other_sources(store, name, replay)
    yield from _other_files(store, name, replay)
    yield from _other_forces(store, name, replay)


def _other_sources(store: RunStore, name: str, replay: Replay) -> Iterator[str]:
    for file, known in replay.made_from.items():
        if file != "config":
            yield from unlike(store.paths.root / file, known, name=file)
        elif known != store.config_hash:
            yield (
                f"replay/{name} was made with the configuration {shown(known)}, the run's is "
                f"{shown(store.config_hash)}"
            )


def _other_files(store: RunStore, name: str, replay: Replay) -> Iterator[str]:
    folder = store.paths.replays / name
    for file, known in replay.files.items():
        yield from unlike(folder / file, known, name=f"replay/{name}/{file}")
    for trial in replay.trials if replay.files else ():
        for path in sorted(store.paths.replay_trial(name, trial.index).glob("*")):
            if str(path.relative_to(folder)) not in replay.files:
                yield f"replay/{name}: {path.relative_to(folder)} was not made by this replay"


def _other_forces(store: RunStore, name: str, replay: Replay) -> Iterator[str]:
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
