"""The preset that a tolerance chooses, and what its neighbours would have cost."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.effects.plan import plan_effects
from sim.error.measured_errors import Setting, indenter_kind, setting_of
from sim.error.prior_error import force_error, time_ratio
from sim.error.section_error import section_force
from sim.error.tolerance import (
    Tolerance,
    alternatives,
    expected_error,
    keeping,
    parse_tolerance,
    settings_by_cost,
)
from sim.scene.indenter import Cylinder, Plane, Sphere
from sim.scene.scene import ContactMode, Preset, Scene, Target
from sim.sensor.sensor import load_sensor
from tacauchy_rig.errors import ConfigError

GEL = load_sensor("gelsight-mini")
SCENE = Scene(
    pad=GEL.pad,
    material=GEL.material,
    indenter=Cylinder(diameter_m=5e-3, fillet_m=0.1e-3),
    target=Target(depth_m=0.5e-3),
)
BALL = replace(SCENE, indenter=Sphere(diameter_m=10e-3))


@given(
    scene=st.sampled_from([SCENE, BALL]),
    depth_m=st.floats(0.1e-3, 0.8e-3),
    allowed=st.floats(0.04, 0.5),
)
def test_the_choice_is_the_cheapest_that_is_believed_to_keep_it(
    scene: Scene, depth_m: float, allowed: float
) -> None:
    """Mesh and effects left out stay within it together; the next cheaper mesh would not."""
    scene = replace(scene, target=Target(depth_m=depth_m))
    chosen = keeping(scene, Tolerance(relative=allowed))
    error, _ = expected_error(chosen, plan_effects(chosen), depth_m=depth_m)
    assert error is not None
    assert error <= allowed * (1.0 + 1e-12)
    order = settings_by_cost(indenter_kind(scene.indenter))
    cheaper = [each for each in order if each.preset is Preset.FAST]
    for each in cheaper[: cheaper.index(setting_of(chosen))][-1:]:
        other, _ = force_error(each.applied(scene))
        assert other is None or other > allowed


@pytest.mark.parametrize("scene", [SCENE, BALL], ids=["punch", "ball"])
def test_a_force_is_as_good_as_the_depth_that_it_leads_to(scene: Scene) -> None:
    """Settings for a force and for the depth at which it is reached are next to each other."""
    force = section_force(scene, depth_m=0.5e-3)
    forced = replace(scene, target=Target(force_n=force))
    order = settings_by_cost(indenter_kind(scene.indenter))
    by_depth, by_force = (
        order.index(setting_of(keeping(each, Tolerance(relative=0.04)))) for each in (scene, forced)
    )
    assert abs(by_depth - by_force) <= 1


def test_newtons_are_taken_relative_to_the_force() -> None:
    """0.05 N is another preset's business at 0.5 N than at 4 N."""
    weak = replace(SCENE, target=Target(force_n=0.5))
    strong = replace(SCENE, target=Target(force_n=4.0))
    order = settings_by_cost(indenter_kind(SCENE.indenter))
    cheap, dear = (setting_of(keeping(s, Tolerance(force_n=0.08))) for s in (weak, strong))
    assert order.index(cheap) < order.index(dear)


def test_what_no_preset_keeps_is_refused_with_the_best() -> None:
    """The message names the nearest preset and what it promises."""
    with pytest.raises(ConfigError) as refused:
        keeping(SCENE, Tolerance(relative=1e-5))
    assert f"preset {Preset.REFERENCE}" in refused.value.message
    assert f"preset {Preset.REFERENCE}" in refused.value.remedy


@pytest.mark.parametrize(
    "scene",
    [replace(SCENE, indenter=Plane()), replace(SCENE, contact=ContactMode.BONDED)],
    ids=["plane", "bonded"],
)
def test_nothing_is_promised_where_nothing_was_measured(scene: Scene) -> None:
    """No preset is chosen by guess; the message says what was not measured."""
    with pytest.raises(ConfigError, match="measured"):
        keeping(scene, Tolerance(relative=0.05))


@pytest.mark.parametrize(
    ("relative", "force_n"), [(None, None), (0.1, 0.1), (0.0, None), (None, -1.0)]
)
def test_a_tolerance_is_one_number_above_zero(
    relative: float | None, force_n: float | None
) -> None:
    """Neither none, nor two, nor nothing at all."""
    with pytest.raises(ConfigError):
        Tolerance(relative=relative, force_n=force_n)


@pytest.mark.parametrize("setting", settings_by_cost(), ids=str)
def test_neighbours_are_cheaper_and_better(setting: Setting) -> None:
    """The cheaper one costs less, the better one errs less; times follow the ratios."""
    kind = indenter_kind(SCENE.indenter)
    scene, order = setting.applied(SCENE), settings_by_cost(kind)
    own, _ = expected_error(scene, plan_effects(scene), depth_m=0.5e-3)
    found = {each.role: each for each in alternatives(scene, depth_m=0.5e-3, wall_s=10.0)}
    ratios = {str(each): time_ratio(each, setting, kind=kind) for each in order}
    assert own is not None
    if "cheaper" in found:
        assert found["cheaper"].time_ratio < 1.0
    if "better" in found:
        assert (found["better"].error_relative or 0.0) < own
    for each in found.values():
        assert each.wall_s == pytest.approx(10.0 * each.time_ratio)
        assert f"{each.wall_s:.2g} s" in str(each)
        assert each.time_ratio == ratios[each.setting]
    ends = {order[0]: {"better"}, order[-1]: {"cheaper"}}
    assert set(found) == ends.get(setting, {"cheaper", "better"})


def test_meshes_nobody_measured_have_no_neighbours() -> None:
    """Nor is an error stated for them."""
    odd = replace(SCENE, refinement=0.777)
    assert force_error(odd)[0] is None
    assert alternatives(odd, depth_m=0.5e-3, wall_s=1.0) == ()


def test_the_papers_element_is_not_counted_twice() -> None:
    """Its locking is in what was measured."""
    paper = replace(SCENE, preset=Preset.PAPER)
    papers, _ = expected_error(paper, plan_effects(paper), depth_m=0.5e-3)
    assert papers == pytest.approx(force_error(paper)[0], rel=1e-3)


def test_where_no_error_is_known_the_neighbours_still_have_a_cost() -> None:
    """A bonded press on preset balanced: what comes next has an unknown error."""
    bonded = replace(SCENE, contact=ContactMode.BONDED)
    found = {each.role: each for each in alternatives(bonded, depth_m=0.5e-3, wall_s=1.0)}
    assert found["better"].setting != Preset.BALANCED
    assert found["better"].error_relative is None
    assert "force error unknown" in str(found["better"])


@pytest.mark.parametrize(
    ("text", "tolerance"),
    [
        ("0.02N", Tolerance(force_n=0.02)),
        ("20 mN", Tolerance(force_n=0.02)),
        ("1%", Tolerance(relative=0.01)),
        (" 0.5 % ", Tolerance(relative=0.005)),
    ],
)
def test_tolerances_are_forces_or_shares(text: str, tolerance: Tolerance) -> None:
    """The unit says which."""
    assert parse_tolerance(text, field="") == tolerance


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("1", '"1" has no unit'),
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
