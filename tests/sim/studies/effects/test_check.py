"""Plans held against everything on: what is compared, and what a catalogue must hold."""

import json
from dataclasses import replace

import pytest

from sim.scene.indenter import Sphere
from sim.scene.material import Material
from sim.scene.pad import DiscPad
from sim.scene.scene import ContactMode, Effect, Output, Preset, Scene, Target
from sim.studies.effects.study import (
    EFFECT_CASES,
    EffectCase,
    Effects,
    check_effects,
    described,
    drawn_scene,
    time_saved,
)
from tacauchy_rig.core.study import Result

SMALL = Scene(
    pad=DiscPad(radius_m=6e-3, height_m=3e-3),
    material=Material(young_pa=4e5, poisson=0.48),
    indenter=Sphere(diameter_m=6e-3),
    target=Target(force_n=0.02),
    preset=Preset.FAST,
    contact=ContactMode.FRICTION,
    friction=0.1,
    tolerance=0.05,
)


def test_the_catalogue_holds_what_the_plan_was_wrong_about() -> None:
    """Names are unique; a large ball with friction 1.0 is pressed to three depths."""
    assert len({case.name for case in EFFECT_CASES}) == len(EFFECT_CASES) >= 8
    assert sum(case.name.startswith("large ball") for case in EFFECT_CASES) >= 3


def test_a_scene_is_held_against_everything() -> None:
    """By force, depths are compared too; what was left out is on in the full press."""
    asked = replace(SMALL, outputs=frozenset({Output.PRESSURE}))
    check = check_effects(EffectCase(name="small", shows="a ball", scene=asked))
    assert set(check["differences"]) == {Output.FORCE, Output.DEPTH, Output.PRESSURE}
    assert {Effect.FRICTION, Effect.GRAVITY, Effect.INERTIA} <= set(check["added"])
    assert check["passed"]
    assert 0.0 < check["differences"][Output.DEPTH] <= check["expected"][Output.DEPTH]
    kept = Effects().tables([Result(name="small", found=check)])[0]
    assert (Output.DEPTH.value, 1, 1) in [row[:3] for row in kept.rows]
    assert time_saved([check]) == pytest.approx(1.0 - check["planned_s"] / check["full_s"])
    assert check["tried_s"] > 0.0
    assert json.loads(json.dumps(check)) == check


def test_what_is_left_out_is_not_extrapolated() -> None:
    """Shear of a press without friction is off by all of it, and not by more on finer meshes."""
    bare = replace(SMALL, friction=0.2, tolerance=0.2)
    check = check_effects(EffectCase(name="small", shows="a ball", scene=bare), errors=True)
    assert Effect.FRICTION in check["added"]
    stated, found = check["errors"][Output.SHEAR]
    assert 0.0 < found < 0.2
    assert stated > 0.0


def test_drawn_scenes_are_the_seeds_own() -> None:
    """The same seed and number draw the same scene; a hundred of them cover what a press can be."""
    scenes = [drawn_scene(3, number) for number in range(100)]
    assert scenes[7] == drawn_scene(3, 7) != drawn_scene(4, 7)
    shares = [s.target.depth_m / s.pad.height_m for s in scenes if s.target.depth_m]
    assert min(shares) < 0.02
    assert max(shares) > 0.35
    assert {scene.contact for scene in scenes} == set(ContactMode)
    for feature in ("layered", "relaxing", "off centre", "slid", "twisted", "tilted"):
        assert any(feature in described(scene) for scene in scenes), feature
