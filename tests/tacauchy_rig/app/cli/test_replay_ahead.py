"""A replay that began while its run was recorded, and the end of the process that began it."""

from __future__ import annotations

from concurrent.futures.process import BrokenProcessPool
from types import SimpleNamespace
from typing import Any

import pytest

from tacauchy_rig.app.cli import folders
from tacauchy_rig.core.errors import AbortedError

BEGUN: Any = object()
RUN: Any = SimpleNamespace(store=SimpleNamespace(paths=SimpleNamespace(root="runs/7")))
REPLAY = SimpleNamespace(models=(), trials=())


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What each replay was told of the process; the first that knows of it finds it gone."""
    told: list[Any] = []

    def replay_run(*_: Any, ahead: Any = None, **__: Any) -> Any:
        told.append(ahead)
        if ahead is not None:
            raise BrokenProcessPool("gone")
        return REPLAY

    monkeypatch.setattr("tacauchy_rig.app.replay.replay.replay_run", replay_run)
    monkeypatch.setattr("tacauchy_rig.app.cli.emulation.emulated_calibration", lambda _: None)
    monkeypatch.setattr(folders, "_say_cost", lambda _: None)
    return told


def test_where_it_is_gone_everything_is_done_anew(
    asked: list[Any], capsys: pytest.CaptureFixture[str]
) -> None:
    """Once, and it is said."""
    folders.replay_and_show(RUN, ahead=BEGUN)
    assert asked == [BEGUN, None]
    assert "beginning anew" in capsys.readouterr().err


def test_ctrl_c_tells_how_the_replay_goes_on(
    monkeypatch: pytest.MonkeyPatch, asked: list[Any]
) -> None:
    """What was recorded is whole, and the command names it."""

    def replay_run(*_: Any, **__: Any) -> Any:
        raise KeyboardInterrupt

    monkeypatch.setattr("tacauchy_rig.app.replay.replay.replay_run", replay_run)
    with pytest.raises(AbortedError, match="Ctrl-C during the replay") as ended:
        folders.replay_and_show(RUN)
    assert "tacauchy-rig replay runs/7" in ended.value.remedy
    assert asked == []


def test_another_process_that_is_gone_is_an_error(
    monkeypatch: pytest.MonkeyPatch, asked: list[Any]
) -> None:
    """There is nothing to begin anew without."""

    def replay_run(*_: Any, **__: Any) -> Any:
        raise BrokenProcessPool("gone")

    monkeypatch.setattr("tacauchy_rig.app.replay.replay.replay_run", replay_run)
    with pytest.raises(BrokenProcessPool):
        folders.replay_and_show(RUN)
    assert asked == []
