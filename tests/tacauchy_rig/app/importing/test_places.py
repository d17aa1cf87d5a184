"""Presses at many places are kept one by one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from reports.evidence.attempt import RunReading
from sim.fields.press_fields import TrialFields
from sim.fields.surface import IntermediateState, SurfaceState
from sim.scene.indenter import Sphere
from tacauchy_rig.app.calibration.optics.of_run import request_of
from tacauchy_rig.app.replay import places
from tacauchy_rig.app.replay.optics import nominal_optics
from tacauchy_rig.app.replay.parts import open_run, parts_of
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.simulated import Replay
from tacauchy_rig.core.store.run_store import ReplayFields
from tests.reports.conftest import record, replay_of
from tests.tacauchy_rig.app.importing.test_parts import blob, imported

BALL = Sphere(diameter_m=6e-3)


def state(depth_m: float) -> SurfaceState:
    """Return a surface of two faces."""
    corners = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 1.0], [0.0, 1.0, 1.0]])
    return SurfaceState(
        positions_rest=corners,
        positions=corners - [0.0, 0.0, depth_m],
        faces=np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32),
        indenter=BALL,
        indenter_position=np.array([0.0, 0.0, 1.0 - depth_m]),
        indenter_rotation=np.eye(3),
        mesh_axis_m=(1e-3, 0.0),
    )


def test_surfaces_are_read_as_they_were_kept() -> None:
    """With other optics only images are made again: from these."""
    half = IntermediateState(
        force_n=0.5, depth_m=1e-4, surface=state(1e-4), pressure_pa=np.arange(4.0)
    )
    fields = TrialFields(
        shape={}, at_nodes={}, at_faces={}, surface=state(2e-4), intermediate=(half,)
    )
    arrays = places.arrays_of(fields)
    read = places.surfaces_of(arrays)
    assert read.intermediate[0].depth_m == half.depth_m
    for found, was in zip(
        [read.intermediate[0].surface, read.surface], [half.surface, fields.surface], strict=True
    ):
        assert found.indenter == BALL
        assert found.mesh_axis_m == was.mesh_axis_m
        np.testing.assert_array_equal(found.positions, was.positions)
        np.testing.assert_array_equal(found.faces, was.faces)


class Bench:
    """Presses that take no time, counted, and cut off after some of them."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.pressed = self.rendered = 0
        self.cut_after = 1000
        patch.setattr(places, "parallel_map", self._map)
        patch.setattr(places, "rendered", self._render)

    def _map(
        self, _: Callable[[Any], Any], items: Sequence[Any], **__: object
    ) -> Iterator[tuple[Any, Any]]:
        for item in items:
            if self.pressed == self.cut_after:
                raise KeyboardInterrupt
            self.pressed += 1
            index = item[1].records[0].index
            fields = TrialFields(shape={}, at_nodes={}, at_faces={}, surface=state(1e-4))
            pressed = replay_of([record(index)]), {index: fields}
            yield item, ((1e-4, 0.5), (4e-4, 1.0)) if len(item) == 2 else pressed

    def _render(self, *args: Any) -> tuple[Replay, dict[int, ReplayFields]]:
        self.rendered += 1
        image = np.zeros((2, 2, 3), np.uint8)
        return args[2], {t.index: ReplayFields(image=image) for t in args[2].trials}


@pytest.fixture
def run(small: Path) -> RunReading:
    """Three presses of a ball at three places."""
    ball = "sphere:diameter=6mm"
    rows = (f"1,0.2,0,0,{ball}", f"1.5,0.3,1,0,{ball}", f"2,0.4,2,0,{ball}")
    return open_run(imported(small, *rows).paths.root)


def test_finished_presses_are_not_pressed_again(
    run: RunReading, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After Ctrl-C in the second part of the work only what is missing is pressed."""
    bench, lines, parts = Bench(monkeypatch), list[str](), parts_of(run)
    optics = nominal_optics(parts[0].inputs.sensor)
    bench.cut_after = 5  # all three with the stated modulus, two with the fitted one
    with pytest.raises(KeyboardInterrupt):
        places.replay_parts(run, parts, optics, on_progress=lines.append)
    bench.cut_after, bench.pressed = 1000, 0
    found = places.replay_parts(run, parts, optics, on_progress=lines.append)
    assert bench.pressed == 1
    assert [each.trials[0].index for each in found] == [1, 2, 3]
    assert "  2 of 3 places are finished from before" in lines
    assert all("left" in line for line in lines if "1 of" in line)


def test_other_optics_render_again_and_another_gel_presses_again(
    run: RunReading, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was pressed stays as long as it was pressed with the same."""
    bench, parts = Bench(monkeypatch), parts_of(run)
    optics = nominal_optics(parts[0].inputs.sensor)
    places.replay_parts(run, parts, optics, on_progress=lambda _: None)
    assert (bench.pressed, bench.rendered) == (6, 3)
    places.replay_parts(run, parts, optics, on_progress=lambda _: None)
    assert (bench.pressed, bench.rendered) == (6, 3)
    other = replace(optics, blur_px=1.0)
    places.replay_parts(run, parts, other, on_progress=lambda _: None)
    assert (bench.pressed, bench.rendered) == (6, 6)
    softer = [replace(each, inputs=each.inputs.stiffer(0.9)) for each in parts]
    places.replay_parts(run, softer, other, on_progress=lambda _: None)
    assert (bench.pressed, bench.rendered) == (12, 9)


def test_a_repeated_replay_presses_nothing(
    run: RunReading, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Presses that found the place, another than that of the replay, are kept beside it."""
    bench, probes = Bench(monkeypatch), parts_of(run)
    optics = nominal_optics(probes[0].inputs.sensor)
    moved = [replace(each, inputs=each.inputs.moved((1e-4, 0.0))) for each in probes]
    for _ in range(2):
        for name, parts in ((places.PROBES_NAME, probes), (places.REPLAY_NAME, moved)):
            places.replay_parts(run, parts, optics, name=name, on_progress=lambda _: None)
        assert bench.pressed == 9


def test_another_process_finds_what_was_kept(run: RunReading) -> None:
    """No address of this process is in what names a press; its sensor has functions."""
    part = parts_of(run)[0]
    assert " at 0x" in repr(part.inputs.sensor)
    assert " at 0x" not in places._written(part)


def test_optics_are_calibrated_from_the_balls_of_a_mixed_run(small: Path) -> None:
    """Of two balls and a cylinder the ball that was pressed most, by the images' own names."""
    names = ("a 1.png", "b.png", "c.png", "d.png")
    for name in names:
        blob(small, name)
    ball, other = "sphere:diameter=6mm", "sphere:diameter=4mm"
    rows = (
        f"{names[0]},1,0.2,0,0,{ball}",
        f"{names[1]},1,0.2,1,0,{other}",
        f'{names[2]},1,0.2,2,0,"cylinder:diameter=4mm,fillet=0.1mm"',
        f"{names[3]},1,0.2,3,0,{ball}",
    )
    run = open_run(imported(small, *rows, images=True).paths.root)
    further: dict[str, Any] = {
        "circles": None,
        "check": None,
        "preset": None,
        "folds": 5,
        "jobs": 1,
    }
    asked: dict[str, Any] = {"background": None, "scale_px_m": None, "out": None, "sensor": None}
    request = request_of(small, run, ball_diameter_m=None, **asked, **further)
    assert request.ball_diameter_m == pytest.approx(6e-3)
    assert request.trials == {"a 1.png": 1, "d.png": 4}
    assert (request.folder / "a 1.png").is_file()
    request = request_of(small, run, ball_diameter_m=4e-3, **asked, **further)
    assert request.trials == {"b.png": 2}
    with pytest.raises(ConfigError, match="balls of this run: 4 mm, 6 mm"):
        request_of(small, run, ball_diameter_m=5e-3, **asked, **further)
