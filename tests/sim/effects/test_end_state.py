"""The end of a press on another mesh than its way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim.effects.effect_plan import full_plan
from sim.effects.end_state import end_state, has_own_way
from sim.effects.outputs import outputs_of
from sim.effects.scene_path import follow, path_for
from sim.press_command import scene_from
from sim.scene.scene import ContactMode, Effect, Output, Scene, Target

SCENE = replace(
    scene_from(
        "--pad disc:radius=5mm,height=3mm --young 0.3MPa --poisson 0.46 --depth 0.3mm "
        "--indenter sphere:diameter=5mm --preset fast --effect inertia=off --effect gravity=off"
    ),
    path_refinement=0.6,
)
PLAN = full_plan(SCENE)


@pytest.mark.parametrize(
    ("scene", "apart"),
    [
        (SCENE, 2e-3),
        (replace(SCENE, contact=ContactMode.FRICTION, friction=0.5), 1e-2),
        (replace(SCENE, target=Target(force_n=0.2)), 2e-3),
    ],
    ids=["frictionless", "friction", "to a force"],
)
def test_the_end_is_that_of_a_way_on_the_same_mesh(scene: Scene, apart: float) -> None:
    """Force and depth are those of all steps on the fine mesh; with friction nearly so."""
    plan = full_plan(scene)
    found = end_state(scene, plan)
    path = path_for(scene, plan, model=found.path.model)
    wanted = follow(scene, path)
    assert found.point.depth_m == pytest.approx(wanted.depth_m, rel=apart)
    assert found.point.force_n[2] == pytest.approx(wanted.force_n[2], rel=apart)
    away = np.abs(found.point.state.positions - wanted.state.positions).max()
    assert away < 0.05 * wanted.depth_m
    assert found.way is not None
    # The way's own mesh is stiffer, by much more than the two ends are apart.
    way, end = found.way.sizes, outputs_of(found.path, found.point).sizes
    changed = [way[output] / end[output] for output in (Output.FORCE, Output.DEPTH)]
    assert max(abs(np.array(changed) - 1.0)) > 0.02
    assert found.path.counts.newton_iterations > path.counts.newton_iterations / 10


def test_what_remembers_its_way_goes_it_on_its_own_mesh() -> None:
    """A gel with mass, and points that hold for ever."""
    assert has_own_way(SCENE, PLAN)
    assert not has_own_way(replace(SCENE, path_refinement=None), PLAN)
    with_mass = replace(SCENE, effects=((Effect.INERTIA, True),))
    assert not has_own_way(with_mass, full_plan(with_mass))
    bonded = replace(SCENE, contact=ContactMode.BONDED, path_refinement=0.6)
    assert not has_own_way(bonded, full_plan(bonded))
    assert end_state(replace(SCENE, path_refinement=None), PLAN).way is None
