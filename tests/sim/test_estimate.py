"""What a press is worth, from the same press on longer edges."""

from __future__ import annotations

from dataclasses import replace

import pytest

from sim.effects.effect_plan import EffectPlan
from sim.effects.outputs import PressOutputs
from sim.effects.plan import plan_effects
from sim.effects.scene_path import CoarsePress, coarse_press
from sim.error import estimate_from, estimated
from sim.press import press
from sim.press_command import scene_from
from sim.scene.scene import ContactMode, Output, Preset, Scene, Target

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
    """Nothing but a rest where nothing changes; a share of the change on top."""
    none, some = (estimate_from(SCENE, PLAN, found, beside(found, k)).force for k in (1.0, 1.1))
    assert none is not None
    assert some is not None
    assert none > 0.0
    assert 0.005 <= some - none <= 0.1
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
