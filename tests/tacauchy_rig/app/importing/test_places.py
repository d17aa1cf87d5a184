"""Indenter and place of presses are what a replay presses, and are kept one by one."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from reports.evidence.frames_and_curves import RunReading
from sim.fields.saved_press import IntermediateState, SurfaceState, TrialFields
from sim.scene.indenter import MeshIndenter, Sphere
from tacauchy_rig.app.calibration.optics.from_run import request_of
from tacauchy_rig.app.importing.importer import import_run
from tacauchy_rig.app.replay import pressed_parts as replay_parts
from tacauchy_rig.app.replay import replay as replaying
from tacauchy_rig.app.replay.chosen_optics import nominal_optics
from tacauchy_rig.app.replay.open_run import open_run
from tacauchy_rig.app.replay.replay import replay_run
from tacauchy_rig.app.replay.report_run import report_run
from tacauchy_rig.app.replay.simulator_inputs import parts_of
from tacauchy_rig.core.arrays import content_hash
from tacauchy_rig.core.errors import ConfigError, RecordError
from tacauchy_rig.core.image_codec import encode_png
from tacauchy_rig.core.simulated import ForceInput, Replay
from tacauchy_rig.core.store.check.run_and_press_check import check_run
from tacauchy_rig.core.store.run_store import ReplayFields, RunStore
from tacauchy_rig.core.time_limit_and_progress import heard
from tests.reports.conftest import record, replay_of

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
    arrays = replay_parts.arrays_of(fields)
    read = replay_parts.surfaces_of(arrays)
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
        patch.setattr(replay_parts, "parallel_map", self._map)
        patch.setattr(replay_parts, "rendered", self._render)

    def _map(
        self, _: Callable[[Any], Any], items: Sequence[Any], **__: object
    ) -> Iterator[tuple[Any, Any]]:
        for item in items:
            if self.pressed == self.cut_after:
                raise KeyboardInterrupt
            self.pressed += 1
            if not isinstance(item, tuple):
                yield item, ((1e-4, 0.5), (4e-4, 1.0))
                continue
            index = item[0].records[0].index
            fields = TrialFields(shape={}, at_nodes={}, at_faces={}, surface=state(1e-4))
            yield item, (replay_of([record(index)]), {index: fields})

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
        replay_parts.replay_parts(run, parts, optics)
    bench.cut_after, bench.pressed = 1000, 0
    with heard(lines.append):
        found = replay_parts.replay_parts(run, parts, optics)
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
    replay_parts.replay_parts(run, parts, optics)
    assert (bench.pressed, bench.rendered) == (6, 3)
    replay_parts.replay_parts(run, parts, optics)
    assert (bench.pressed, bench.rendered) == (6, 3)
    other = replace(optics, blur_px=1.0)
    replay_parts.replay_parts(run, parts, other)
    assert (bench.pressed, bench.rendered) == (6, 6)
    softer = [replace(each, inputs=each.inputs.stiffer(0.9)) for each in parts]
    replay_parts.replay_parts(run, softer, other)
    assert (bench.pressed, bench.rendered) == (12, 9)


def test_a_repeated_replay_presses_nothing(
    run: RunReading, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Presses that found the place, another than that of the replay, are kept beside it."""
    bench, probes = Bench(monkeypatch), parts_of(run)
    optics = nominal_optics(probes[0].inputs.sensor)
    moved = [replace(each, inputs=each.inputs.moved((1e-4, 0.0))) for each in probes]
    for _ in range(2):
        for name, parts in ((replay_parts.PROBES_NAME, probes), (replay_parts.REPLAY_NAME, moved)):
            replay_parts.replay_parts(run, parts, optics, name=name)
        assert bench.pressed == 9


def test_another_process_finds_what_was_kept() -> None:
    """No address of this process is in what names a press."""
    assert len({content_hash(each) for each in (object(), object())}) == 1


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


HEAD = "image,fz,depth,x,y,tool"
_CORNERS = [(x, y, z) for z in (0, 4) for y in (-2, 2) for x in (-2, 2)]
_SIDES = ("023 031", "457 476", "015 054", "267 273", "046 062", "137 175")


def _stl() -> bytes:
    """Return a cube of 4 mm as an STL of text; normals are found from the corners."""
    faces = [face for side in _SIDES for face in side.split()]
    lines = ["solid cube"]
    for face in faces:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {' '.join(map(str, _CORNERS[int(c)]))}" for c in face]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid cube", ""]).encode()


CUBE = _stl()


def imported(folder: Path, *rows: str, force: bool = True, images: bool = False) -> RunStore:
    """Import presses, each by its force, depth, place and tool, and before that its image."""
    told = rows if images else [f"press.png,{row}" for row in rows]
    (folder / "presses.csv").write_text("\n".join([HEAD, *told]))
    text = (folder / "import.toml").read_text().replace("[rig.replay]\nindenter", "[rig.replay]\n#")
    axes = "\n".join(f'{axis} = {{ column = "{axis}", unit = "mm" }}' for axis in "xy")
    if not force:
        text = text.replace('force = { column = "fz", unit = "N" }', "")
    text = text.replace("[rig.replay]", '[rig.replay]\npreset = "fast"\npose = "stated"')
    text = text.replace("[rig.sensor]", f'{axes}\nindenter = "tool"\n[rig.sensor]')
    (folder / "import.toml").write_text(text)
    return import_run(folder, parent=folder.parent)


def blob(folder: Path, name: str, *, x_px: int = 0) -> None:
    """Write an image of the gel with something pressed beside the middle."""
    there = np.hypot(*np.mgrid[-240:240, -320 - x_px : 320 - x_px]) < 60
    pressed = np.where(there[..., None], np.uint8((150, 90, 60)), np.uint8(90))
    (folder / name).write_bytes(encode_png(np.asarray(pressed, np.uint8)))


def test_what_all_presses_share_is_replayed(small: Path) -> None:
    """One ball at one place, to a few micrometres."""
    ball = "sphere:diameter=6mm"
    store = imported(small, f"1,0.2,1.5,-2,{ball}", f"2,0.3,1.51,-2,{ball}")
    (part,) = parts_of(open_run(store.paths.root))
    assert isinstance(part.inputs.indenter, Sphere)
    assert part.inputs.indenter.diameter_m == pytest.approx(6e-3)
    assert part.inputs.offset_m == pytest.approx((1.505e-3, -2e-3))
    assert part.place_known


def test_presses_unlike_each_other_are_parts(small: Path) -> None:
    """Each has its indenter and its place; where no place is stated, none is made up."""
    (small / "cube.stl").write_bytes(CUBE)
    rows = (
        "1,,0,0,sphere:diameter=6mm",
        "1,,2,-1,sphere:diameter=6mm",
        '1,,0,0,"mesh:cube.stl,unit=mm"',
        "1,,0,0.01,sphere:diameter=6mm",
        "1,,,,sphere:diameter=6mm",
    )
    parts = parts_of(open_run(imported(small, *rows).paths.root))
    assert [list(part.trials) for part in parts] == [[1, 4], [2], [3], [5]]
    assert [type(part.inputs.indenter) for part in parts] == [Sphere, Sphere, MeshIndenter, Sphere]
    assert parts[1].inputs.offset_m == pytest.approx((2e-3, -1e-3))
    assert [part.place_known for part in parts] == [True, True, True, False]


def test_an_indenter_that_is_none_is_refused_at_once(small: Path) -> None:
    """By import, not by a replay hours later."""
    rows = ("1,,0,0,sphere:diameter=6mm", "1,,0,0,star:diameter=6mm")
    with pytest.raises(RecordError, match=r'line 3, column "tool": .star'):
        imported(small, *rows)


def no_inputs(*_: object) -> tuple[ForceInput, ...]:
    """Return what no uncertain input changes: trying each takes most of a replay's time."""
    return ()


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_two_balls_at_two_places_with_and_without_force(
    small: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each is pressed with its own, and compared with its like alone."""
    monkeypatch.setattr(replaying, "force_inputs", no_inputs)
    blob(small, "press.png")
    blob(small, "beside.png", x_px=40)
    rows = (
        "press.png,1,0.2,0,0,sphere:diameter=6mm",
        "press.png,2,0.35,0,0,sphere:diameter=6mm",
        "beside.png,1.5,0.35,2.5,0,sphere:diameter=4mm",
        "beside.png,,0.3,2.5,0,sphere:diameter=4mm",
    )
    run = open_run(imported(small, *rows, images=True).paths.root)
    replay = replay_run(run)
    assert [model.indenter for model in replay.models] == [
        "sphere:diameter=6mm",
        "sphere:diameter=4mm",
    ]
    assert [model.trials for model in replay.models] == [(1, 2), (3, 4)]
    assert replay.others[0].centre_x_m == pytest.approx(2.5e-3)
    assert replay.others[0].modulus_factor == replay.model.modulus_factor is not None
    assert math.isnan(replay.trials[3].force_measured_n)
    assert check_run(run.store).passed, list(check_run(run.store).missed())
    report, paths = report_run(open_run(run.store.paths.root))
    floors = [trial.floors for trial in report.trials]
    assert [each is not None and each.wrong_force is not None for each in floors] == [True] * 4
    matrix = report.matrices[0]
    assert math.isfinite(matrix.values[0][1])
    assert math.isnan(matrix.values[0][2])
    page = paths.html.read_text()
    assert "sphere:diameter=4mm" in page
    assert "2.50, 0.00" in page


@pytest.mark.slow
def test_presses_without_a_force_are_replayed_to_their_depths(
    small: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The simulator meets the depths, and no force is made up as measured."""
    # Nothing here reads the coarse presses that tell uncertainties; they take most of the time.
    monkeypatch.setattr(
        replaying, "_uncertainties", lambda _run, parts, *_: ([() for _ in parts], None)
    )
    blob(small, "press.png")
    ball = "sphere:diameter=6mm"
    rows = (f",0.2,0,0,{ball}", f",0.3,0,0,{ball}")
    run = open_run(imported(small, *rows, force=False).paths.root)
    replay = replay_run(run)
    depths = [trial.depth_simulated_m for trial in replay.trials]
    assert depths == pytest.approx([0.2e-3, 0.3e-3], rel=1e-6)
    assert all(math.isnan(trial.force_measured_n) for trial in replay.trials)
    assert replay.trials[1].force_simulated_n > replay.trials[0].force_simulated_n > 0.1
    assert check_run(run.store).passed, list(check_run(run.store).missed())
    report, paths = report_run(open_run(run.store.paths.root))
    assert [trial.force_measured_n for trial in report.trials] == [None, None]
    assert all(trial.metrics is not None for trial in report.trials)
    assert "NaN" not in paths.summary.read_text()


def test_presses_with_neither_are_not_replayed(small: Path) -> None:
    """There is nothing to press to."""
    run = open_run(imported(small, ",,0,0,", force=False).paths.root)
    with pytest.raises(RecordError, match="force"):
        replay_run(run)


def test_a_tool_of_a_press_lies_within_the_folder(small: Path) -> None:
    """As one of import.toml does."""
    with pytest.raises(RecordError, match="the presses' indenter"):
        imported(small, '1,0.2,0,0,"mesh:/etc/hostname,unit=mm"')
