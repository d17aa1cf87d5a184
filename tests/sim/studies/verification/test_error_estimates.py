"""Estimates of the force error beside true errors."""

from __future__ import annotations

import pytest

from sim.scene.indenter import Sphere
from sim.scene.material import Material
from sim.scene.pad import DiscPad
from sim.scene.scene import Preset, Scene, Target
from sim.studies.verification.forces import (
    BELIEVED,
    HELD_OUT,
    estimate_row,
    judged_estimates,
    refined_press,
)
from tacauchy_rig.core.tables import Cell

SCENE = Scene(
    pad=DiscPad(radius_m=5e-3, height_m=3e-3),
    material=Material(young_pa=3e5, poisson=0.46),
    indenter=Sphere(diameter_m=5e-3),
    target=Target(depth_m=0.05e-3),
    preset=Preset.FAST,
)


def test_ten_scenes_are_held_out() -> None:
    """No two are alike."""
    scenes = list(HELD_OUT.values())
    assert len(scenes) == 10
    assert all(a != b for k, a in enumerate(scenes) for b in scenes[:k])


def test_small_scene_has_an_estimate_and_a_true_error() -> None:
    """Three meshes of one ball: the estimate holds, and says something."""
    found = refined_press("ball", SCENE, finer=1.5)
    assert 0.0 < float(found["true error"] or 0.0) < float(found[BELIEVED] or 0.0) < 0.3
    assert found["inside"] == "yes"


def press_with(*, finer_n: float) -> dict[str, Cell]:
    """Return a press that was never made."""
    return estimate_row("made up", SCENE, 1.0, finer_n, 0.02)


@pytest.mark.parametrize(("outside", "passed"), [(0, True), (1, True), (2, False)])
def test_nine_of_ten_must_lie_inside(outside: int, passed: bool) -> None:
    """Two that lie outside fail the section."""
    found = [press_with(finer_n=0.5 if k < outside else 0.999) for k in range(10)]
    section = judged_estimates(found)
    assert section.passed is passed
    assert [row[-1] for row in section.rows].count("no") == outside
