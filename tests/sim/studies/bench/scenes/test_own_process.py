"""Scenes in processes of their own: numbers come back, and so does what went wrong."""

from __future__ import annotations

from math import isnan
from pathlib import Path

import pytest

from sim.studies.bench.scenes import own_process
from sim.studies.bench.scenes.catalogue import BenchScene
from sim.studies.bench.scenes.own_process import Order, checked_out, pressed
from tacauchy_rig.errors import ConfigError

_SHALLOW = {"indenter": "sphere:diameter=10mm", "depth": "0.1mm"}


def test_what_does_not_go_is_a_row_that_says_so() -> None:
    """An impossible scene in another process: no numbers, and the reason."""
    deep = BenchScene(name="through", stated={**_SHALLOW, "depth": "40mm"})
    row = pressed(deep, Order())
    assert row.press is None
    assert "goes through a gel" in row.failure
    assert row.setting == "failed"
    assert isnan(row.frames_per_s)


def test_a_process_that_crashes_is_a_row_that_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its status and its last words stand there."""
    program = tmp_path / "press.py"
    program.write_text("import sys\nsys.exit('no more memory')\n")
    monkeypatch.setattr(own_process.worker, "__file__", str(program))
    monkeypatch.setattr(own_process, "OWN", tmp_path)
    row = pressed(BenchScene(name="any", stated=_SHALLOW), Order(checkout=tmp_path))
    assert row.failure == "its process ended with status 1: no more memory"


def test_a_batch_presses_the_scene_too() -> None:
    """Friction and all: the first environment's force is that of the press alone."""
    scene = BenchScene(name="rubbed", stated={**_SHALLOW, "contact": "friction:0.5"})
    alone, two = (pressed(scene, Order(environments=count)).press for count in (None, 2))
    assert alone is not None
    assert two is not None
    assert two.force_n[2] == pytest.approx(alone.force_n[2], rel=5e-3)
    assert two.balance <= 1e-5


def test_a_commit_that_is_none_is_refused() -> None:
    """The message is git's, the remedy ours."""
    with pytest.raises(ConfigError, match="git worktree"), checked_out("no-such-commit"):
        pass
