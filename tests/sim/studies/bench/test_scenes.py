"""The benchmark's scenes as data."""

from __future__ import annotations

import pytest

from sim.scene.indenter import MeshIndenter
from sim.scene.scene import ContactMode
from sim.studies.bench.press import stated_scene
from sim.studies.bench.scenes import all_scenes, drawn_scenes, select_scenes
from tacauchy_rig.core.errors import ConfigError


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
