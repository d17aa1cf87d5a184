"""Estimated errors of a press, and the settings that keep a tolerance."""

from dataclasses import replace
from typing import Any

import pytest

from sim.cheapest_setting import RELATIVE_COSTS, alternatives, keeping, setting_of
from sim.effects.effect_choice import plan_effects
from sim.effects.planned_effects import EffectPlan
from sim.effects.press_outputs import PressOutputs
from sim.effects.press_with_effects import CoarsePress, coarse_press
from sim.error_estimate import NOT_ASKED, estimate_from, estimated, failed
from sim.mesh_bias_correction import Setting
from sim.press import press
from sim.press_arguments import scene_from
from sim.scene.indenter import Sphere
from sim.scene.scene import ContactMode, Output, Preset, Scene, Target
from sim.tolerance import Tolerance, parse_tolerance
from tacauchy_rig.core.errors import ConfigError, ConvergenceError, TimeLimitError

SCENE = scene_from(
    "--pad disc:radius=5mm,height=3mm --young 0.3MPa --poisson 0.46 "
    "--indenter sphere:diameter=5mm --depth 0.15mm --preset fast"
)
PLAN = plan_effects(SCENE)


@pytest.fixture(scope="module")
def found() -> PressOutputs:
    """Return a ball's outputs on the mesh that is judged."""
    return coarse_press(SCENE, PLAN, 1.0).outputs


def beside(found: PressOutputs, force_ratio: float) -> CoarsePress:
    """Return a coarse press that differs in its force alone."""
    outputs = replace(found, force_n=force_ratio * found.force_n)
    return CoarsePress(ratio=0.5, outputs=outputs, processor_s=0.1)


def test_an_estimate_grows_with_what_longer_edges_change(found: PressOutputs) -> None:
    """Nothing but a rest where nothing changes; on top a share of the change, or all of it."""
    none, some, all_of_it = (
        estimate_from(SCENE, PLAN, found, beside(found, k)).relative[Output.FORCE]
        for k in (1.0, 1.1, 1.4)
    )
    assert none > 0.0
    assert 0.005 <= some - none <= 0.1
    assert all_of_it - none == pytest.approx(0.4)
    assert "edges 2 times as long change the force by 10.00%" in (
        estimate_from(SCENE, PLAN, found, beside(found, 1.1)).basis
    )


def test_what_is_left_out_is_added(found: PressOutputs) -> None:
    """Every output's own sum."""
    rows = {effect: replace(row, costs={}) for effect, row in PLAN.rows.items()}
    bare = EffectPlan(rows=rows, tolerances=PLAN.tolerances)
    coarse = beside(found, 1.1)
    more, less = (estimate_from(SCENE, each, found, coarse).relative for each in (PLAN, bare))
    left_out = PLAN.left_out(Output.FORCE)
    assert left_out > 0.0
    assert more[Output.FORCE] - less[Output.FORCE] == pytest.approx(left_out)


def test_shorter_edges_leave_a_smaller_rest(found: PressOutputs) -> None:
    """What no extrapolation sees falls with the edges, and with the barrier, which has a floor."""
    coarse = beside(found, 1.0)
    once, twice = (
        estimate_from(replace(SCENE, refinement=k), PLAN, found, coarse).relative[Output.IMAGE]
        for k in (1.0, 2.0)
    )
    assert 0.25 * once <= twice < 0.5 * once


def test_no_force_has_no_error(found: PressOutputs) -> None:
    """An indenter in the air is told so."""
    nothing = replace(found, force_n=0.0 * found.force_n)
    told = estimate_from(SCENE, PLAN, nothing, beside(found, 1.0))
    assert told.force is None
    assert "no force" in told.basis


def test_a_force_that_fell_on_the_way_is_stated_whole(found: PressOutputs) -> None:
    """Under either mesh: it came to another equilibrium, which other meshes may not."""
    coarse, slipped = beside(found, 1.0), replace(found, fell_relative=0.3)
    usual = estimate_from(SCENE, PLAN, found, coarse).relative[Output.FORCE]
    assert found.fell_relative == 0.0
    for own, other in ((slipped, coarse), (found, replace(coarse, outputs=slipped))):
        told = estimate_from(SCENE, PLAN, own, other)
        assert told.relative[Output.FORCE] == pytest.approx(usual + 0.3)
        assert "+ 30.00% (fall in a load step)" in told.basis


def test_beyond_the_rules_the_gap_is_added_or_the_press_refused(found: PressOutputs) -> None:
    """Half the pad, or a ball's radius; within, and where time was short, all stays as it is."""
    told = estimate_from(SCENE, PLAN, found, beside(found, 1.0))
    broken, late = failed(ConvergenceError("knotted")), failed(TimeLimitError("late"))
    within: dict[str, Any] = {"depth_m": 1.4e-3, "gap": 0.4, "ratio_min": -0.1}
    deeper = within | {"depth_m": 1.6e-3, "ratio_min": 0.2}
    assert all(each.beyond_rules(SCENE, **within) is each for each in (told, broken, late))
    assert told.beyond_rules(SCENE, **deeper).force == pytest.approx(
        told.relative[Output.FORCE] + 0.4
    )
    assert told.beyond_rules(SCENE, **within, at_rim=True).relative[Output.FORCE] > 0.4
    assert told.beyond_rules(SCENE, **deeper | {"gap": 0.0}).relative == told.relative
    small = replace(SCENE, indenter=Sphere(diameter_m=1e-3))
    assert told.beyond_rules(small, **within | {"ratio_min": 0.2}).relative[Output.FORCE] > 0.4
    assert late.beyond_rules(SCENE, **deeper).force is None
    assert NOT_ASKED.beyond_rules(SCENE, **deeper | {"ratio_min": -0.1}) is NOT_ASKED
    for error, more, why in ((broken, {}, "knotted"), (told, {"ratio_min": -0.1}, "inside out")):
        with pytest.raises(ConvergenceError, match=f"1.6000 mm nothing tells .*{why}") as refused:
            error.beyond_rules(SCENE, **deeper | more)
        assert "press less deep" in refused.value.remedy


@pytest.mark.parametrize(
    "scene",
    [
        SCENE,
        pytest.param(replace(SCENE, target=Target(depth_m=1.4e-3)), marks=pytest.mark.slow),
        pytest.param(replace(SCENE, contact=ContactMode.BONDED), marks=pytest.mark.slow),
        replace(SCENE, contact=ContactMode.FRICTION, friction=0.8),
        replace(SCENE, target=Target(force_n=0.05)),
    ],
    ids=["ball", "to 47 %", "bonded", "friction", "to a force"],
)
def test_a_press_lies_within_its_estimate(scene: Scene) -> None:
    """Edges half as long change no output by more than is said."""
    plan = plan_effects(scene)
    own, fine = (coarse_press(scene, plan, ratio).outputs for ratio in (1.0, 2.0))
    said = estimated(scene, plan, own)
    changes = own.changes(fine)
    asked = Output.FORCE if scene.target.force_n is None else Output.DEPTH
    for output in (asked, Output.IMAGE, Output.MARKERS, Output.SHEAR):
        assert changes[output] <= said.relative[output] < 0.6, output


def test_a_result_has_its_errors_and_what_they_took() -> None:
    """A ball to a load; of the paper's linear elements the error is that they lock."""
    result = press(replace(SCENE, target=Target(force_n=0.05)), estimate_error=True)
    found = result.as_json()
    assert set(found["estimated_errors"]) == set(Output)
    assert found["wall_s"]["estimate"] > 0.0
    assert found["estimated_force_error_basis"].startswith("Richardson: edges 2 times as long")
    assert press(SCENE).estimated_force_error_relative is None


@pytest.mark.slow
def test_linear_tetrahedra_are_held_against_quadratic_ones() -> None:
    """Preset paper has one mesh, which locks by tens of per cent."""
    result = press(replace(SCENE, preset=Preset.PAPER), estimate_error=True)
    assert result.estimated_force_error_relative is not None
    assert result.estimated_force_error_relative > 0.3


ROUNDED = scene_from(
    "--sensor gelsight-mini --indenter cylinder:diameter=5mm,fillet=0.1mm --depth 0.5mm"
)
BALL = replace(ROUNDED, indenter=Sphere(diameter_m=10e-3))


ORDER = list(RELATIVE_COSTS)  # the cheapest first


def test_the_choice_is_the_cheapest_that_is_believed_to_keep_it() -> None:
    """Half the tolerance takes finer edges, and what is left of it is for effects."""
    loose, tight = (keeping(BALL, Tolerance(relative=share)) for share in (0.04, 0.02))
    assert ORDER.index(setting_of(loose)) < ORDER.index(setting_of(tight))
    for chosen, share in ((loose, 0.04), (tight, 0.02)):
        assert chosen.tolerance is not None
        assert 0.0 <= chosen.tolerance < share
    errors = [RELATIVE_COSTS[setting_of(each)].error_ratio for each in (loose, tight)]
    assert (0.04 - (loose.tolerance or 0.0)) / errors[0] == pytest.approx(
        (0.02 - (tight.tolerance or 0.0)) / errors[1]
    )


def test_a_choice_is_kept_by_the_press_that_it_leads_to() -> None:
    """The press at the settings chosen is itself said to err by no more."""
    chosen = keeping(BALL, Tolerance(relative=0.08))
    said = press(chosen, estimate_error=True).estimated_force_error_relative
    assert 0.0 < (said or 0.0) < 0.08


def test_newtons_are_taken_relative_to_the_force() -> None:
    """0.05 N is another preset's business at 0.5 N than at 4 N."""
    weak = replace(ROUNDED, target=Target(force_n=0.5))
    strong = replace(ROUNDED, target=Target(force_n=4.0))
    cheap, dear = (setting_of(keeping(s, Tolerance(force_n=0.08))) for s in (weak, strong))
    assert ORDER.index(cheap) < ORDER.index(dear)


def test_what_no_preset_keeps_is_refused_with_the_best() -> None:
    """The message names the nearest preset and its estimated error."""
    with pytest.raises(ConfigError) as refused:
        keeping(ROUNDED, Tolerance(relative=1e-5))
    assert "preset fast, edges 0.303 times as long comes nearest" in refused.value.message
    assert "choose preset fast" in refused.value.remedy


def test_what_cannot_be_pressed_has_no_setting() -> None:
    """The message says what became of the coarse press."""
    with pytest.raises(ConfigError, match="no preset is known to keep"):
        keeping(replace(BALL, target=Target(depth_m=0.0)), Tolerance(relative=0.05))


@pytest.mark.parametrize(
    ("relative", "force_n"), [(None, None), (0.1, 0.1), (0.0, None), (None, -1.0)]
)
def test_a_tolerance_is_one_number_above_zero(
    relative: float | None, force_n: float | None
) -> None:
    """Neither none, nor two, nor nothing at all."""
    with pytest.raises(ConfigError):
        Tolerance(relative=relative, force_n=force_n)


@pytest.mark.parametrize("setting", RELATIVE_COSTS, ids=str)
def test_neighbours_are_cheaper_and_better(setting: Setting) -> None:
    """The cheaper one costs less, the better one errs less; times follow the ratios."""
    found = {each.role: each for each in alternatives(setting.applied(ROUNDED), 0.02, wall_s=10.0)}
    if "cheaper" in found:
        assert found["cheaper"].time_ratio < 1.0
    if "better" in found:
        assert (found["better"].error_relative or 1.0) < 0.02
    for each in found.values():
        assert each.wall_s == pytest.approx(10.0 * each.time_ratio)
        assert f"{each.wall_s:.2g} s" in str(each)
    ends = {ORDER[0]: {"better"}, Setting(Preset.FAST, 3.3): {"cheaper"}}
    assert set(found) >= ends.get(setting, {"cheaper"})


def test_where_no_error_is_known_the_neighbours_still_have_a_cost() -> None:
    """A press whose error nobody asked for; meshes that nobody measured have no neighbours."""
    assert alternatives(replace(ROUNDED, refinement=0.777), 0.02, wall_s=1.0) == ()
    found = {each.role: each for each in alternatives(ROUNDED, None, wall_s=1.0)}
    assert found["better"].setting != Preset.BALANCED
    assert found["better"].error_relative is None
    assert "force error unknown" in str(found["better"])


@pytest.mark.parametrize(
    ("text", "tolerance"),
    [("20 mN", Tolerance(force_n=0.02)), (" 0.5 % ", Tolerance(relative=0.005))],
)
def test_tolerances_are_forces_or_shares(text: str, tolerance: Tolerance) -> None:
    """The unit says which."""
    assert parse_tolerance(text, field="") == tolerance


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("0.01", '"0.01" has no unit'),
        ("1 mm", '"1 mm" is no tolerance'),
        ("small", '"small" is no tolerance'),
        ("0,5%", '"0,5%" is no tolerance'),
    ],
)
def test_a_tolerance_needs_its_unit(text: str, problem: str) -> None:
    """One could be meant as newtons or percent, and would be all of the force."""
    with pytest.raises(ConfigError) as caught:
        parse_tolerance(text, field="replay.tolerance")
    assert caught.value.message == f"replay.tolerance: {problem}"
    assert caught.value.remedy == "give 0.02N or 1%"
