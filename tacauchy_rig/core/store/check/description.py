"""Files of the run as a whole against their hashes, and the configuration against itself."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from typing import Any

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import Criterion
from tacauchy_rig.core.store.check.contradiction import agreement, shown, unlike
from tacauchy_rig.core.store.check.journal import JournalReading
from tacauchy_rig.core.store.run_store import RunStore
from tacauchy_rig.core.store.seals import Seal

_REMEDY = (
    "what the run is was edited after it was recorded: restore run.json and rig.toml from a copy, "
    "or record a new run"
)


def judge_description(store: RunStore, journal: JournalReading) -> Criterion:
    """Say whether ``run.json`` still is what the run was recorded with."""
    return agreement(
        "run_description",
        "run.json and what lies beside it are as they were when the run was recorded",
        _contradictions(store, journal),
        remedy=_REMEDY,
    )


def _contradictions(store: RunStore, journal: JournalReading) -> Iterator[str]:
    described, said = store.description, store.config_hash
    recorded = described.get("config")
    found = hashlib.sha256(json.dumps(recorded, sort_keys=True).encode()).hexdigest()
    if found != said:
        yield f"run.json: config has the hash {shown(found)}, config_hash says {shown(said)}"
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
        yield from unlike(store.paths.rig_toml, written)
    sealed = journal.seals(Seal.WRITTEN)
    for name in dict.fromkeys(str(event.detail.get("file")) for event in sealed):
        told = [event for event in sealed if event.detail.get("file") == name]
        known = [event.detail.get("sha256") for event in told]
        # The line goes out before the file: where it is the journal's last, a crash may have left
        # the file that the line before tells of, or none.
        may_be_older = journal.events[-1] is told[-1]
        if not may_be_older or len(told) > 1:
            yield from unlike(store.paths.root / name, *known[-2 if may_be_older else -1 :])


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
