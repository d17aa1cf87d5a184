"""The benchmark's scenes, and their tables."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from sim.mesh_bias_correction import Corrected
from sim.scene.indenter import MeshIndenter
from sim.scene.scene import ContactMode
from sim.studies.bench.scenes import (
    Manner,
    Reference,
    ScenePress,
    SceneRow,
    all_scenes,
    drawn_scenes,
    read_references,
    scene_tables,
    scenes_figure,
)
from sim.studies.bench.timed_press import stated_scene
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.store.json_codec import dumps


def test_every_kind_of_press_is_among_the_scenes() -> None:
    """Thirteen names, each a scene that can be built; no effect of a press is forgotten."""
    scenes = {name: stated_scene(stated) for name, stated in all_scenes().items()}
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


def test_drawn_scenes_can_be_built_and_are_a_seeds_own() -> None:
    """Their names tell what they are; another seed draws others."""
    for name, stated in drawn_scenes(5).items():
        scene = stated_scene(stated)
        assert ("friction" in name) == (scene.contact is ContactMode.FRICTION)
        assert ("sliding" in name) == any(scene.motion.shift_m)
        assert ("pushed" in name) == (scene.target.force_n is not None)
    assert drawn_scenes(5) == drawn_scenes(5) != drawn_scenes(6)


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


def _row(press: ScenePress | None = _PRESS, **others: Any) -> SceneRow:
    return SceneRow(**{"scene": "one", "manner": Manner(), "press": press, **others})


def _known(press: ScenePress | None = _PRESS, **stated: str) -> SceneRow:
    reference = replace(_REFERENCE, stated=stated) if stated else _REFERENCE
    return _row(press, reference=reference)


def test_forces_are_held_against_the_reference() -> None:
    """F_z at a depth, the depth at a load; a twist by its moment."""
    assert _known().error() == pytest.approx(0.02)
    assert _known().sideways_error is None
    softer = replace(_PRESS, depth_m=0.51e-3, force_n=(0.3, 0.4, 2.0))
    assert _known(softer, force="2N", shift="1mm").error() == pytest.approx(0.02)
    assert _known(force="2N", shift="1mm").sideways_error == pytest.approx(0.0)
    assert _known(twist="5deg").sideways_error == pytest.approx(0.1)


def test_a_corrected_result_is_what_counts() -> None:
    """The raw one stays beside it."""
    known = Corrected(
        force_n=1.98, depth_m=0.495e-3, error_relative=0.01, bias_relative=0.03, basis=""
    )
    press = replace(_PRESS, corrected=known)
    assert _known(press).error() == pytest.approx(-0.01)
    assert _known(press).error(raw=True) == pytest.approx(0.02)
    assert _known(press, force="2N").error() == pytest.approx(-0.01)


def test_speed_counts_processor_time_and_its_mean_is_geometric() -> None:
    """Twenty frames in 0.2 s of the processor, whatever the wall says; with one of 50 ms: 200."""
    quick = replace(_PRESS, cpu_s=0.05)
    assert _row().frames_per_s == pytest.approx(100.0)
    speed = scene_tables([_row(), _row(quick), _row(None, failure="no")])[0]
    assert "Geometric mean 200.0 frames/s, least 100.0, of 2 scenes of 3." in speed.note


@pytest.mark.parametrize(
    ("rows", "met"),
    [
        ([_known()], [True, True, True]),
        ([_known(), _known(replace(_PRESS, cpu_s=2.5))], [False, True, True]),
        ([_known(replace(_PRESS, force_n=(0.0, 0.0, 1.89)))], [True, False, True]),
        ([_known(), _row(scene="unknown")], [True, False, True]),
        ([_known(), _row(None, scene="two", failure="it stopped")], [False, False, True]),
    ],
)
def test_a_criterion_can_be_missed(rows: list[SceneRow], met: list[bool]) -> None:
    """A slow scene, a force too far off, one without a reference, one without numbers."""
    tables = scene_tables(rows)
    assert [table.passed for table in tables] == met
    assert tables[0].criterion == "geometric mean at least 60 frames/s, none below 15"
    assert tables[1].criterion == (
        "F_z, or the depth at a given load, within 5% of the reference in every scene"
    )


def test_references_are_read_back_for_the_same_scene_only(tmp_path: Path) -> None:
    """A scene that was changed since has none; a damaged file is named."""
    file = tmp_path / "references.json"
    scenes = {"one": _REFERENCE.stated}
    assert read_references(file, scenes) == {}
    file.write_bytes(dumps({"one": _REFERENCE}))
    assert read_references(file, scenes) == {"one": _REFERENCE}
    assert read_references(file, {"one": {"depth": "1mm"}}) == {}
    file.write_bytes(dumps({"references": {"one": _REFERENCE}}))
    assert read_references(file, scenes) == {"one": _REFERENCE}
    file.write_text("{")
    with pytest.raises(ConfigError, match=r"references\.json holds no references"):
        read_references(file, scenes)


def test_bars_are_drawn_where_there_are_numbers() -> None:
    """A failed scene has a name and no bar."""
    (axes,) = scenes_figure([(_row(), _row(None, scene="two", failure="no"))]).axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["one", "two"]
    assert [bar.get_width() for bar in axes.patches] == [pytest.approx(100.0), 0.0]
