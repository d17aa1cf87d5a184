"""Scenes in processes of their own: numbers come back, and so does what went wrong."""

from __future__ import annotations

import json
from dataclasses import asdict
from math import isnan
from pathlib import Path

import pytest

from sim.studies.bench.scenes import own_process
from sim.studies.bench.scenes.catalogue import BenchScene
from sim.studies.bench.scenes.own_process import Order, pressed, pressed_together

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
    alone = pressed(scene, Order()).press
    one, two = (
        row.press
        for row in pressed_together(scene, [Order(environments=count) for count in (1, 2)])
    )
    assert alone is not None
    assert one is not None
    assert two is not None
    assert one.force_n == pytest.approx(two.force_n, rel=1e-4, abs=1e-6)
    assert two.force_n[2] == pytest.approx(alone.force_n[2], rel=5e-3)
    assert two.balance <= 1e-5


def test_what_was_pressed_before_a_crash_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first of three batches has its numbers; the others say how the process ended."""
    press = pressed(BenchScene(name="any", stated=_SHALLOW), Order(environments=1)).press
    assert press is not None
    program = tmp_path / "press.py"
    line = json.dumps(asdict(press))
    program.write_text(f"import sys\nprint('Warp says')\nprint({line!r})\nsys.exit('full')\n")
    monkeypatch.setattr(own_process.worker, "__file__", str(program))
    monkeypatch.setattr(own_process, "OWN", tmp_path)
    orders = [Order(environments=count, checkout=tmp_path) for count in (1, 60, 1024)]
    rows = pressed_together(BenchScene(name="any", stated=_SHALLOW), orders)
    assert rows[0].press is not None
    assert rows[0].press.wall_s == press.wall_s
    assert {row.failure for row in rows[1:]} == {"its process ended with status 1: full"}
