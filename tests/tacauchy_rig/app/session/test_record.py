"""What a run notes beside its presses."""

from __future__ import annotations

from collections.abc import Callable

from tacauchy_rig.app.session.record import note_changes
from tacauchy_rig.core.config.load import Change
from tacauchy_rig.core.store.journal import read_journal
from tacauchy_rig.core.store.run_store import RunStore


def test_what_was_changed_stands_in_the_journal(new_store: Callable[..., RunStore]) -> None:
    """Old and new value, and run.json stays as it was recorded."""
    store = new_store()
    before = store.paths.run_json.read_bytes()
    note_changes(store, ())
    note_changes(store, [Change(field="limits.stale_image", old="500 ms", new="1 s")])
    (event,) = [e for e in read_journal(store.paths.journal) if e.name == "resume-set"]
    assert event.detail == {
        "changes": [{"field": "limits.stale_image", "old": "500 ms", "new": "1 s"}]
    }
    assert store.paths.run_json.read_bytes() == before
