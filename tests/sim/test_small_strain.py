"""Presses at small strains, and what they tell of a mesh's error."""

from __future__ import annotations

from dataclasses import replace

import pytest

from sim.indenter import Cylinder, Sphere
from sim.pad import BoxPad
from sim.pilot import ANCHOR, FINEST, Pilot, is_piloted, pilot_depth
from sim.press import press
from sim.scene import Material, Preset, Scene, Target
from sim.settings import FAST, SETTINGS, Setting
from sim.small_strain import small_strain_force

_BALL = Scene(
    pad=BoxPad(size_x_m=20e-3, size_y_m=20e-3, height_m=4e-3),
    material=Material(young_pa=0.4e6, poisson=0.45),
    indenter=Sphere(diameter_m=8e-3),
    target=Target(depth_m=0.1e-3),
    preset=Preset.FAST,
)
_PUNCH = replace(_BALL, indenter=Cylinder(diameter_m=5e-3, fillet_m=0.25e-3))


@pytest.mark.parametrize("scene", [_BALL, _PUNCH], ids=["ball", "punch"])
def test_a_shallow_press_is_one_at_small_strains(scene: Scene) -> None:
    """At 2.5 % of the pad the linear force is the real one within 4 %."""
    linear = small_strain_force(scene, depth_m=0.1e-3)
    assert linear.force_n == pytest.approx(press(scene).force_n[2], rel=0.04)


def test_a_guess_of_the_reach_changes_no_force() -> None:
    """Started from far too wide or too narrow it comes to the same."""
    free = small_strain_force(_BALL, depth_m=0.2e-3)
    for reach in (0.5 * free.reach_m, 1.5 * free.reach_m):
        guessed = small_strain_force(_BALL, depth_m=0.2e-3, reach_m=reach)
        assert guessed.force_n == pytest.approx(free.force_n, rel=2e-3)


def test_a_ball_touches_less_than_it_would_cut() -> None:
    """Hertz: sqrt(R d) where sqrt(2 R d) lies inside the undeformed gel."""
    depth = 0.1e-3
    reach = small_strain_force(replace(_BALL, preset=Preset.BALANCED), depth_m=depth).reach_m
    assert reach == pytest.approx((4e-3 * depth) ** 0.5, rel=0.2)


def test_a_pilot_finds_finer_meshes_better() -> None:
    """Errors fall from meshes coarser than fast's to accurate; each mesh is pressed once."""
    pilot = Pilot(_BALL, 0.2e-3)
    coarse, fast = (pilot.error(each) for each in (Setting(Preset.FAST, 0.7), FAST))
    assert coarse > fast > pilot.error(FINEST) > 0.0
    assert pilot.over_anchor(ANCHOR) == 0.0
    expected = (1.0 + fast) / (1.0 + pilot.error(ANCHOR)) - 1.0
    assert pilot.over_anchor(FAST) == pytest.approx(expected, rel=1e-9)


def test_a_pilot_finds_the_depth_of_a_force() -> None:
    """Within 5 % of where the press itself ends."""
    forced = replace(_BALL, target=Target(force_n=0.3))
    assert pilot_depth(_BALL) == _BALL.target.depth_m
    assert pilot_depth(forced) == pytest.approx(press(forced).depth_m, rel=0.05)


def test_a_pilot_judges_what_is_no_finer_than_its_finest() -> None:
    """Neither the paper's mesh nor those above preset accurate."""
    judged = [setting for setting in SETTINGS if is_piloted(setting)]
    assert judged[-1] == FINEST
    assert {setting.preset for setting in judged} == {
        Preset.FAST,
        Preset.BALANCED,
        Preset.ACCURATE,
    }
