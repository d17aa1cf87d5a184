"""The optics of an emulated sensor, calibrated while its run is recorded; Ctrl-C in a replay."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from types import SimpleNamespace
from typing import Any

import pytest

from tacauchy_rig.app.cli import emulation, folders
from tacauchy_rig.app.cli.emulation import begin_calibration
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.errors import AbortedError

FOUND: Any = object()
HERE: Any = SimpleNamespace(name="here")


def _store(*overrides: str) -> Any:
    config = load_config(None, overrides=overrides).config
    return SimpleNamespace(config=config, paths=SimpleNamespace(root="runs/7"))


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Each calibration of a sensor, by name."""
    made: list[str] = []

    def calibrate(sensor: Any, say: Any) -> Any:
        made.append(sensor.name)
        say("calibrating")
        return FOUND

    monkeypatch.setattr(emulation, "emulated_calibration", lambda _: calibrate)
    return made


def test_what_began_while_recording_is_not_done_again(calls: list[str]) -> None:
    """What it said is said when it is asked for."""
    said: list[str] = []
    with ThreadPoolExecutor(1) as worker:
        calibrate = begin_calibration(_store(), worker)
        assert calibrate is not None
        assert calibrate(HERE, said.append) is FOUND
    assert (calls, said) == (["gelsight-mini"], ["calibrating"])


def test_a_killed_worker_is_named_and_the_calibration_done_here(calls: list[str]) -> None:
    """The replay does not end because of it."""
    gone: Future[Any] = Future()
    gone.set_exception(BrokenProcessPool("gone"))
    broken: Any = SimpleNamespace(submit=lambda *_: gone)
    calibrate = begin_calibration(_store(), broken)
    said: list[str] = []
    assert calibrate is not None
    assert calibrate(HERE, said.append) is FOUND
    assert calls == ["here"]
    assert "calibrating again" in said[0]


def test_a_calibration_file_leaves_nothing_to_begin(calls: list[str]) -> None:
    """Its optics are read, not fitted."""
    with ThreadPoolExecutor(1) as worker:
        store = _store('sensor.optics_calibration="optics.npz"')
        begin_calibration(store, worker)
    assert calls == []


def test_ctrl_c_tells_how_the_replay_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """What was recorded is whole, and the command names it."""

    def replay_run(*_: Any, **__: Any) -> Any:
        raise KeyboardInterrupt

    monkeypatch.setattr("tacauchy_rig.app.replay.replay.replay_run", replay_run)
    run: Any = SimpleNamespace(store=_store())
    with pytest.raises(AbortedError, match="Ctrl-C during the replay") as ended:
        folders.replay_and_show(run, None)
    assert "tacauchy-rig replay runs/7" in ended.value.remedy
