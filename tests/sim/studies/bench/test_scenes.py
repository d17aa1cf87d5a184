"""The benchmark's scenes, and their tables."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from sim.correction import Corrected
from sim.scene.indenter import MeshIndenter
from sim.scene.scene import ContactMode
from sim.studies.bench.press import stated_scene
from sim.studies.bench.scene_tables import draw_scenes, scene_tables
from sim.studies.bench.scenes import (
    BenchScene,
    Manner,
    Reference,
    ScenePress,
    SceneRow,
    all_scenes,
    drawn_scenes,
    read_references,
    select_scenes,
)
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.store.codec import dumps


def test_every_kind_of_press_is_among_the_scenes() -> None:
    """Thirteen names, each a scene that can be built; no effect of a press is forgotten."""
    scenes = {scene.name: stated_scene(scene.stated) for scene in all_scenes()}
    assert len(scenes) == 13
    built = list(scenes.values())
    assert sum(scene.contact is ContactMode.FRICTION for scene in built) >= 4
    assert any(any(scene.motion.shift_m) for scene in built)
    assert any(scene.motion.twist_rad for scene in built)
    assert any(any(scene.motion.tilt_rad) for scene in built)
    assert any(isinstance(scene.indenter, MeshIndenter) for scene in built)
    assert any(len(scene.layers) == 2 for scene in built)
    assert any(scene.material.poisson > 0.498 for scene in built)
    assert {scene.sensor for scene in built} == {"gelsight-mini", "digit", "9dtact"}


def test_a_pattern_chooses_scenes() -> None:
    """A part of a name will do; none that fits is an error that names them all."""
    assert [scene.name for scene in select_scenes("sliding")] == ["ball, sliding"]
    assert select_scenes() == select_scenes("") == all_scenes()
    several = select_scenes("twisted", "shallow", "*shallow")
    assert [scene.name for scene in several] == ["ball, shallow", "punch, twisted"]
    assert {scene.name for scene in select_scenes("DIGIT*friction")} == {"DIGIT, friction"}
    with pytest.raises(ConfigError, match="no such scene") as refused:
        select_scenes("ball", "cube")
    assert "ball, sliding" in str(refused.value)


def test_drawn_scenes_can_be_built_and_are_a_seeds_own() -> None:
    """Their names tell what they are, and choose among them; another seed draws others."""
    for drawn in drawn_scenes(5):
        scene = stated_scene(drawn.stated)
        assert ("friction" in drawn.name) == (scene.contact is ContactMode.FRICTION)
        assert ("sliding" in drawn.name) == any(scene.motion.shift_m)
        assert ("pushed" in drawn.name) == (scene.target.force_n is not None)
    assert drawn_scenes(5) == drawn_scenes(5) != drawn_scenes(6)
    assert [each.name for each in select_scenes("ball", drawn=5)] == [
        each.name for each in drawn_scenes(5) if each.name.startswith("ball")
    ]


_PRESS = ScenePress(
    preset="fast",
    edges=1.0,
    promised=True,
    tet_count=500,
    unknown_count=2300,
    setup_s=0.1,
    wall_s=0.4,
    cpu_s=0.2,
    iterations=230,
    force_n=(0.3, 0.4, 2.04),
    moment_nm=(0.0, 0.0, 1.1e-3),
    depth_m=0.5e-3,
    stiffness_n_m=4000.0,
    balance=1.2e-8,
)

_REFERENCE = Reference(
    stated={"depth": "0.5mm"},
    press=replace(_PRESS, preset="reference", force_n=(0.0, 0.5, 2.0), moment_nm=(0.0, 0.0, 1e-3)),
    command="tacauchy-rig bench",
    commit="abc",
)


def _row(name: str = "one", press: ScenePress | None = _PRESS, failure: str = "") -> SceneRow:
    return SceneRow(scene=name, manner=Manner(), press=press, failure=failure)


def test_forces_are_held_against_the_reference() -> None:
    """F_z at a depth, the depth at a load; a twist by its moment."""
    assert _REFERENCE.error(_PRESS) == pytest.approx(0.02)
    assert _REFERENCE.sideways_error(_PRESS) is None
    pushed = replace(_REFERENCE, stated={"force": "2N", "shift": "1mm"})
    softer = replace(_PRESS, depth_m=0.51e-3, force_n=(0.3, 0.4, 2.0))
    assert pushed.error(softer) == pytest.approx(0.02)
    assert pushed.sideways_error(_PRESS) == pytest.approx(0.0)
    assert replace(_REFERENCE, stated={"twist": "5deg"}).sideways_error(_PRESS) == pytest.approx(
        0.1
    )


def test_a_corrected_result_is_what_counts() -> None:
    """The raw one stays beside it."""
    known = Corrected(
        force_n=1.98, depth_m=0.495e-3, error_relative=0.01, bias_relative=0.03, basis=""
    )
    press = replace(_PRESS, corrected=known)
    assert _REFERENCE.error(press) == pytest.approx(-0.01)
    assert _REFERENCE.raw_error(press) == pytest.approx(0.02)
    pushed = replace(_REFERENCE, stated={"force": "2N"})
    assert pushed.error(press) == pytest.approx(-0.01)


def test_speed_counts_processor_time_and_its_mean_is_geometric() -> None:
    """Twenty frames in 0.2 s of the processor, whatever the wall says; with one of 50 ms: 200."""
    quick = replace(_PRESS, cpu_s=0.05)
    assert _row().frames_per_s == pytest.approx(100.0)
    speed = scene_tables([_row(), _row(press=quick), _row(press=None, failure="no")], {})[0]
    assert "Geometric mean 200.0 frames/s, least 100.0, of 2 scenes of 3." in speed.note


@pytest.mark.parametrize(
    ("rows", "met"),
    [
        ([_row()], [True, True, True]),
        ([_row(), _row(press=replace(_PRESS, cpu_s=2.5))], [False, True, True]),
        ([_row(press=replace(_PRESS, force_n=(0.0, 0.0, 1.89)))], [True, False, True]),
        ([_row(), _row("unknown")], [True, False, True]),
        ([_row(), _row("two", None, "the press stopped")], [False, False, True]),
    ],
)
def test_a_criterion_can_be_missed(rows: list[SceneRow], met: list[bool]) -> None:
    """A slow scene, a force too far off, one without a reference, one without numbers."""
    tables = scene_tables(rows, {"one": _REFERENCE})
    assert [table.passed for table in tables] == met
    assert tables[0].criterion == "geometric mean at least 60 frames/s, none below 15"
    assert tables[1].criterion == (
        "F_z, or the depth at a given load, within 5% of the reference in every scene"
    )


def test_nothing_is_judged_without_any_reference() -> None:
    """The page says so, and how to make one."""
    worth = scene_tables([_row()], {})[1]
    assert worth.result == "reported"
    assert "`--reference` makes: one." in worth.note


def test_a_setting_that_promises_nothing_is_marked() -> None:
    """With a star; edges of another length stand behind the preset."""
    assert _row().setting == "fast"
    unpromised = replace(_PRESS, promised=False, edges=1.0 / 1.2)
    assert _row(press=unpromised).setting == "fast 0.83*"


def test_launches_are_listed_where_a_batch_has_them() -> None:
    """In microseconds; a group that was pressed with images says so."""
    manner = Manner(environments=60, images=True)
    timed = replace(_row(press=replace(_PRESS, parts_s={"gel": 2e-6})), manner=manner)
    *_, table = scene_tables([timed, _row("two")], {})
    assert table.title == "Launches, cpu, 60 environments, with images"
    assert table.rows == (("one", 2.0), ("two", None))


def test_references_are_read_back_for_the_same_scene_only(tmp_path: Path) -> None:
    """A scene that was changed since has none; a damaged file is named."""
    file = tmp_path / "references.json"
    scene = BenchScene(name="one", stated=_REFERENCE.stated)
    assert read_references(file, [scene]) == {}
    file.write_bytes(dumps({"one": _REFERENCE}))
    assert read_references(file, [scene]) == {"one": _REFERENCE}
    assert read_references(file, [replace(scene, stated={"depth": "1mm"})]) == {}
    file.write_bytes(dumps({"references": {"one": _REFERENCE}}))
    assert read_references(file, [scene]) == {"one": _REFERENCE}
    file.write_text("{")
    with pytest.raises(ConfigError, match=r"references\.json holds no references"):
        read_references(file, [scene])


def test_bars_are_drawn_where_there_are_numbers(tmp_path: Path) -> None:
    """A failed scene has a name and no bar; without any number there is no figure."""
    failed = _row("two", None, "no")
    files = draw_scenes([(_row(), failed)], tmp_path)
    assert [file.name for file in files] == ["scenes.pdf", "scenes.png"]
    assert draw_scenes([(failed,)], tmp_path) == []
