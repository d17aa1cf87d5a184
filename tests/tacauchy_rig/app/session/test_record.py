"""What a run notes beside its presses."""

from __future__ import annotations

from pathlib import Path

from tacauchy_rig.app.session.record import note_changes
from tacauchy_rig.core.config.load import Change, default_text, load_config
from tacauchy_rig.core.store.journal import read_journal
from tacauchy_rig.core.store.run_store import RunStore


def test_what_was_changed_stands_in_the_journal(tmp_path: Path) -> None:
    """Old and new value, and run.json stays as it was recorded."""
    store = RunStore.create(
        tmp_path, load_config(), config_text=default_text(), simulated=True, versions={}
    )
    before = store.paths.run_json.read_bytes()
    note_changes(store, ())
    note_changes(store, [Change(field="limits.stale_image", old="500 ms", new="1 s")])
    (event,) = [e for e in read_journal(store.paths.journal) if e.name == "resume-set"]
    assert event.detail == {
        "changes": [{"field": "limits.stale_image", "old": "500 ms", "new": "1 s"}]
    }
    assert store.paths.run_json.read_bytes() == before
