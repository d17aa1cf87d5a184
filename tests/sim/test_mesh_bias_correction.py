"""Forces and depths without the bias of their mesh."""

from dataclasses import replace

import pytest

from sim.cheapest_setting import alternatives, keeping_corrected
from sim.effects.planned_effects import full_plan
from sim.effects.press_outputs import PressOutputs
from sim.effects.press_with_effects import coarse_press
from sim.error_estimate import guaranteed
from sim.mesh_bias_correction import WAY, corrected_settings, correction, rules_of
from sim.press import press
from sim.press_arguments import scene_from
from sim.scene.indenter import Cylinder, Plane
from sim.scene.material import LawName
from sim.scene.scene import ContactMode, Motion, Output, Preset, Scene, Target
from sim.tolerance import Tolerance
from tacauchy_rig.core.errors import ConfigError

SCENE = replace(
    scene_from("--sensor gelsight-mini --indenter sphere:diameter=8mm --depth 0.4mm --preset fast"),
    path_refinement=WAY,
)
PUSHED = replace(SCENE, target=Target(force_n=0.7))
STUCK = replace(SCENE, contact=ContactMode.FRICTION, friction=0.8)
PLAN = full_plan(SCENE)


@pytest.fixture(scope="module")
def found() -> PressOutputs:
    """Return a ball's outputs."""
    return coarse_press(SCENE, PLAN, 0.75).outputs


def test_a_given_depth_has_its_force_corrected(found: PressOutputs) -> None:
    """The mesh is too stiff: the force is less, by the bias, and the depth stays."""
    result = correction(SCENE, PLAN, found, found)
    assert result is not None
    assert result.force_n * (1.0 + result.bias_relative) == pytest.approx(found.force_n[2])
    assert result.depth_m == found.depth_m
    assert 0.0 < result.error_relative < result.bias_relative < 0.1


def test_a_given_force_has_its_depth_corrected(found: PressOutputs) -> None:
    """There the gel is pressed deeper: by what the force that was missing takes."""
    by_depth, by_force = (correction(each, PLAN, found, found) for each in (SCENE, PUSHED))
    assert by_depth is not None
    assert by_force is not None
    missing = found.force_n[2] - by_depth.force_n
    assert by_force.force_n == found.force_n[2]
    assert by_force.depth_m - found.depth_m == pytest.approx(missing / found.stiffness_n_m)
    # A ball's force grows more than in proportion to its depth, which errs the less.
    assert by_force.error_relative < by_depth.error_relative


def test_what_a_bias_depends_on() -> None:
    """Edges, how well the gel keeps its volume, depth, friction on short edges, the pad's sides."""
    soft = replace(SCENE, material=replace(SCENE.material, poisson=0.4))
    aside = replace(SCENE, centre_m=(8.5e-3, 0.0))
    deep = replace(SCENE, target=Target(depth_m=0.8e-3))
    rules = rules_of(SCENE)
    assert rules_of(STUCK) == rules_of(deep) == dict(sorted(rules.items()))
    assert rules[1.4].bias(SCENE) < min(rules[1.4].bias(deep), rules[1.4].bias(STUCK))
    punch = replace(STUCK, indenter=Cylinder(diameter_m=4e-3, fillet_m=0.3e-3))
    held = rules_of(punch)[2.2]
    assert held.bias(punch) > held.bias(replace(punch, friction=0.1))
    for rule in rules.values():
        assert rule.bias(soft) < rule.bias(SCENE) <= rule.bias(STUCK)
        assert rule.bias(aside) == pytest.approx(rule.bias(SCENE) + rule.beside)


def test_more_remains_of_the_bias_deeper_than_drawn_presses_went() -> None:
    """The ball is pressed to 0.31 of the pad's height, and to 0.29 of it."""
    at = [
        replace(SCENE, target=Target(depth_m=share * SCENE.pad.height_m)) for share in (0.29, 0.31)
    ]
    rule = rules_of(SCENE)[1.0]
    drawn, deeper = (rule.rest(each) for each in at)
    assert deeper == pytest.approx(rule.deeper * rule.bias(at[1]))
    assert deeper > 3.0 * drawn
    assert rule.rest(at[0], share=0.5) == pytest.approx(0.5 * drawn)


def test_more_remains_where_a_ball_has_slid() -> None:
    """By a fifth of its contact's radius or more: twice as much."""
    rest = replace(rules_of(SCENE)[1.0], of_bias=0.0).rest
    slid = [replace(STUCK, motion=Motion(shift_m=(1e-4 * tenths, 0.0))) for tenths in (0, 1, 5)]
    still, little, far = (rest(each) for each in slid)
    assert still < little < far == pytest.approx(2.0 * still)


def test_more_remains_in_a_low_pad_and_in_layers() -> None:
    """Than in a high pad of one material: 1.39 times as much, and 1.35 times."""
    low = replace(SCENE, pad=replace(SCENE.pad, height_m=2.5e-3))
    layered = scene_from("--sensor 9dtact --indenter sphere:diameter=8mm --depth 0.4mm")
    rest = replace(rules_of(SCENE)[1.4], of_bias=0.0).rest
    times = [rest(each) / rest(SCENE) for each in (low, layered)]
    assert times == pytest.approx([1.39, 1.35], 1e-2)


def test_a_punch_that_holds_ends_on_shorter_edges() -> None:
    """Its load steps then have preset fast's own; without friction longer ones, as a ball's."""
    punch = replace(SCENE, indenter=Cylinder(diameter_m=5e-3, fillet_m=0.5e-3))
    slides, holds, ball = (
        {setting.refinement: setting.path_refinement for setting in corrected_settings(scene)}
        for scene in (punch, replace(STUCK, indenter=punch.indenter), SCENE)
    )
    assert (slides, ball) == ({1.0: WAY, 1.6: WAY}, {1.0: WAY, 1.4: WAY})
    assert holds == {1.0: 0.75, 2.2: 1.0}


def test_a_body_of_triangles_has_longer_edges_where_that_is_enough() -> None:
    """At 5 % and not at 3 %, its way's longer yet; on layers an ellipsoid was 5 % off."""
    words = "--sensor {} --indenter object:hexagon --depth 0.4mm --tolerance {}"
    at_five, at_three, layered = (
        scene_from(words.format(*given))
        for given in (("gelsight-mini", "5%"), ("gelsight-mini", "3%"), ("9dtact", "5%"))
    )
    assert (at_five.refinement, at_five.path_refinement) == (0.6, 0.6 * WAY)
    assert at_three.refinement == layered.refinement == 1.0
    assert at_three.path_refinement == WAY
    low, rule = replace(at_five.pad, height_m=2.5e-3), rules_of(at_five)[0.6]
    assert rule.bias(replace(at_five, pad=low)) == pytest.approx(0.625 * rule.bias(at_five))


@pytest.mark.parametrize(
    "other",
    [
        replace(SCENE, contact=ContactMode.BONDED),
        replace(SCENE, target=Target(depth_m=2.5e-3)),
        replace(SCENE, target=Target(depth_m=0.0)),
        replace(SCENE, indenter=Plane()),
        replace(SCENE, material=replace(SCENE.material, law=LawName.PAPER_EQ4)),
        replace(STUCK, outputs=frozenset({Output.SHEAR})),
    ],
    ids=["bonded", "deep", "untouched", "plane", "rest stress", "shear by friction"],
)
def test_what_was_not_drawn_is_not_corrected(other: Scene) -> None:
    """Nothing is known of its bias."""
    assert corrected_settings(other) == {}


def test_presets_by_name_stay_as_they_are(found: PressOutputs) -> None:
    """Neither has a press on one mesh a corrected value, nor one of another preset."""
    assert correction(replace(SCENE, path_refinement=None), PLAN, found, None) is None
    assert correction(replace(SCENE, preset=Preset.BALANCED), PLAN, found, found) is None


def test_a_tolerance_takes_the_cheapest_that_leaves_so_little() -> None:
    """What is left of it is for effects; less than any correction leaves is the raw force's."""
    settings = corrected_settings(SCENE)
    stated = {each.refinement: worth.error_ratio for each, worth in settings.items()}
    for share in (0.05, 0.01):
        chosen = keeping_corrected(SCENE, Tolerance(relative=share))
        assert chosen.path_refinement == WAY
        assert stated[chosen.refinement] + (chosen.tolerance or 0.0) == pytest.approx(share)
        assert all(error > share for name, error in stated.items() if name < chosen.refinement)
    newtons = keeping_corrected(PUSHED, Tolerance(force_n=0.05 * 0.7))
    relative = keeping_corrected(PUSHED, Tolerance(relative=0.05))
    assert newtons == replace(relative, tolerance=pytest.approx(relative.tolerance))
    with pytest.raises(ConfigError, match="no preset is known"):
        keeping_corrected(SCENE, Tolerance(relative=1e-5))


def test_the_guaranteed_quantity_is_named_throughout() -> None:
    """A press to a force has its depth guaranteed, below the tolerance, and its neighbours'."""
    chosen = keeping_corrected(PUSHED, Tolerance(relative=0.05))
    result = press(chosen, estimate_error=True)
    assert guaranteed(chosen) is Output.DEPTH
    assert result.guaranteed == "depth"
    assert result.corrected is not None
    assert result.guaranteed_error_relative == result.corrected.error_relative < 0.05
    assert result.corrected.depth_m > result.depth_m
    assert result.force_n[2] == pytest.approx(0.7, rel=1e-4)
    assert {each.quantity for each in result.alternatives} == {"depth"}
    assert all("depth error" in str(each) for each in result.alternatives)
    assert alternatives(chosen, None, wall_s=None)[0].quantity == "force"
