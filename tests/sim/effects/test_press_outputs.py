"""Outputs of a press, and its end on a finer mesh than its way."""

from dataclasses import replace

import numpy as np
import pytest

from sim.effects.planned_effects import full_plan
from sim.effects.press_outputs import PressOutputs, outputs_of
from sim.effects.press_with_effects import end_state, follow, has_own_way, path_for
from sim.press_arguments import scene_from
from sim.scene.indenter import Cylinder
from sim.scene.scene import ContactMode, Effect, Motion, Output, Scene, Target

SCENE = replace(
    scene_from(
        "--pad disc:radius=6mm,height=3mm --young 0.4MPa --poisson 0.45 --depth 0.2mm "
        "--indenter sphere:diameter=6mm --contact friction:0.5 --preset fast --effect inertia=off"
    ),
    refinement=0.6,
)


def found(scene: Scene) -> PressOutputs:
    """Return the outputs of a press."""
    plan = full_plan(scene)
    path = path_for(scene, plan)
    return outputs_of(path, follow(scene, path))


@pytest.fixture(scope="module")
def rough() -> PressOutputs:
    """Return a ball's outputs with friction."""
    return found(SCENE)


def test_what_the_contact_carries_is_the_force(rough: PressOutputs) -> None:
    """Pressure over the touched faces, on a quarter, is F_z but for the surface's slope."""
    carried = float(rough.pressure_pa @ rough.areas_m2)
    assert carried == pytest.approx(rough.force_n[2], rel=0.03)
    assert rough.sizes[Output.DEPTH] == pytest.approx(0.2e-3)
    touched = rough.pressure_pa[rough.pressure_pa > 0.0]
    assert touched.min() < rough.sizes[Output.PRESSURE] <= touched.max()


def test_a_press_does_not_differ_from_itself(rough: PressOutputs) -> None:
    """Nothing of every output, and all of those that are scaled by a share."""
    assert set(rough.differences(rough).values()) == {0.0}
    more = replace(rough, force_n=1.1 * rough.force_n, motion_m=1.2 * rough.motion_m)
    differences = more.differences(rough)
    assert differences[Output.FORCE] == pytest.approx(0.1)
    assert differences[Output.MARKERS] == pytest.approx(0.2)
    assert differences[Output.IMAGE] == 0.0


def test_without_friction_shear_and_markers_go_first(rough: PressOutputs) -> None:
    """A straight press loses its shear and much of its motion, and little of its force."""
    lost = found(replace(SCENE, effects=(*SCENE.effects, (Effect.FRICTION, False)))).differences(
        rough
    )
    assert lost[Output.FORCE] < 0.1 * lost[Output.SHEAR]
    assert lost[Output.FORCE] < 0.1 * lost[Output.MARKERS]
    assert np.all(np.array(list(lost.values())) >= 0.0)


def test_pressure_under_a_fillet_is_no_shear() -> None:
    """Faces are flat where the indenter bends away; without friction it pushes along its normal."""
    punch = Cylinder(diameter_m=4e-3, fillet_m=0.4e-3)
    free = found(replace(SCENE, indenter=punch, contact=ContactMode.FRICTIONLESS, friction=0.0))
    assert free.sizes[Output.SHEAR] < 1e-9


def test_shear_of_another_mesh_is_compared_face_by_face(rough: PressOutputs) -> None:
    """Turned round it is twice itself off, though its size is the same; a finer one's is near."""
    assert rough.shear_change(rough) == pytest.approx(0.0, abs=1e-9)
    back = replace(rough, shear_pa=-rough.shear_pa)
    assert back.shear_change(rough) == pytest.approx(2.0 * rough.sizes[Output.SHEAR])
    assert back.changes(rough)[Output.SHEAR] == pytest.approx(0.0, abs=1e-12)
    finer = found(replace(SCENE, refinement=1.0))
    assert 0.0 < rough.shear_change(finer) < 0.2


def test_a_quarter_is_compared_with_the_whole_on_the_quarter(rough: PressOutputs) -> None:
    """The whole pad has places that a quarter does not model."""
    whole = found(replace(SCENE, effects=(*SCENE.effects, (Effect.SYMMETRY, False))))
    assert (rough.copies, whole.copies) == (4, 1)
    ways = rough.shear_change(whole), whole.shear_change(rough)
    assert ways[0] == pytest.approx(ways[1], rel=0.05)
    assert max(ways) < rough.sizes[Output.SHEAR]


def test_what_slides_under_a_load_keeps_its_stiffness() -> None:
    """It sinks while the force stays: the force of a ball grows with the depth's 1.5th power."""
    pushed = replace(
        SCENE, target=Target(force_n=0.1), motion=Motion(shift_m=(0.2e-3, 0.0)), friction=0.3
    )
    slid = found(pushed)
    grows = slid.stiffness_n_m * slid.depth_m / float(slid.force_n[2])
    assert 1.3 < grows < 2.2


CARRIED = replace(
    scene_from(
        "--pad disc:radius=5mm,height=3mm --young 0.3MPa --poisson 0.46 --depth 0.3mm "
        "--indenter sphere:diameter=5mm --preset fast --effect inertia=off --effect gravity=off"
    ),
    path_refinement=0.6,
)
PLAN = full_plan(CARRIED)
SLIPS = replace(
    CARRIED,
    contact=ContactMode.FRICTION,
    friction=0.3,
    indenter=Cylinder(diameter_m=5e-3, fillet_m=0.3e-3),
    target=Target(depth_m=0.6e-3),
)


@pytest.mark.parametrize(
    ("scene", "apart"),
    [
        (CARRIED, 2e-3),
        (replace(CARRIED, contact=ContactMode.FRICTION, friction=0.5), 1.2e-3),
        (SLIPS, 5e-3),
        (replace(CARRIED, target=Target(force_n=0.2)), 2e-3),
    ],
    ids=["frictionless", "friction", "friction under a punch", "to a force"],
)
def test_the_end_is_that_of_a_way_on_the_same_mesh(scene: Scene, apart: float) -> None:
    """Force and depth are those of all steps on the fine mesh.

    With friction the last of them are: a punch's force would be 1.3 % off without.
    """
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
    """A gel with mass pressed quickly, and points that hold for ever."""
    assert has_own_way(CARRIED, PLAN)
    assert not has_own_way(replace(CARRIED, path_refinement=None), PLAN)
    with_mass = replace(CARRIED, effects=((Effect.INERTIA, True),), duration_s=1e-3)
    assert not has_own_way(with_mass, full_plan(with_mass))
    bonded = replace(CARRIED, contact=ContactMode.BONDED, path_refinement=0.6)
    assert not has_own_way(bonded, full_plan(bonded))
    assert end_state(replace(CARRIED, path_refinement=None), PLAN).way is None
