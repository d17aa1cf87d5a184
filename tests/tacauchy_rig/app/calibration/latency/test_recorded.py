"""Delays of a recorded run, and what is made of a declared trigger."""

from __future__ import annotations

import pytest

from tacauchy_rig.app.calibration.latency import Delay, find_latency, trigger_missed
from tacauchy_rig.core.config.load import default_text, load_config
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.store.run_store import RunStore


def _delay(delay_s):
    return Delay(delay_s=delay_s, uncertainty_s=5e-4, explained=0.99, sample_count=300)


def _config(mode):
    return load_config(overrides=[f'run.sync_mode="{mode}"']).config


def test_a_trigger_that_keeps_its_word_is_believed():
    """Image and force of one moment are stamped within a quarter of a frame."""
    assert not trigger_missed(_config("external_trigger"), _delay(0.004), _delay(0.009))


def test_a_trigger_that_does_not_is_named():
    """Images 30 ms behind the force are no triggered ones."""
    missed = trigger_missed(_config("external_trigger"), _delay(0.004), _delay(0.034))
    assert "+30.0 ms" in missed


def test_without_a_declared_trigger_nothing_is_missed():
    """A host clock promises nothing."""
    assert not trigger_missed(_config("host_clock"), _delay(0.004), _delay(0.034))


def test_a_run_that_did_not_sway_is_refused(tmp_path):
    """The remedy names the command that makes one."""
    store = RunStore.create(
        tmp_path, load_config(), config_text=default_text(), simulated=True, versions={}
    )
    store.paths.journal.write_bytes(b"")
    with pytest.raises(RecordError, match="swayed") as caught:
        find_latency(store)
    assert "calibrate latency" in caught.value.remedy
