"""Loading paths: steps, the search for a force, and what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.effects.planned_effects import full_plan
from sim.effects.press_with_effects import path_for
from sim.material.laws.law_and_lame import law
from sim.mesh.elements import ElementOrder
from sim.mesh.revolved_mesh import Grading, revolved_mesh
from sim.press import press
from sim.press_arguments import scene_from
from sim.scene.indenter import Cylinder, Sphere, tilted
from sim.scene.material import LawName
from sim.scene.pad import DiscPad
from sim.solve.force_search import find_force
from sim.solve.load_steps import CarryPhase, ForcePhase, Phase
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model
from sim.solve.refused_overlap import base_depth_m, faces_gel
from tacauchy_rig.core.errors import ConfigError, TimeLimitError
from tests.sim.test_press import small_model


def _carried(twist_rad: float, *, load_n: float | None = None) -> CarryPhase:
    return CarryPhase(
        goal="there",
        shift_m=np.array([3e-4, 4e-4, 0.0]),
        twist_rad=twist_rad,
        load_n=load_n,
        radius_m=2e-3,
        step_max_m=5e-5,
    )


@given(twist=st.floats(-3.0, 3.0), parts=st.integers(1, 7))
def test_turns_add_up_to_the_twist(twist: float, parts: int) -> None:
    """In any number of steps the rotation stays one, and ends at the whole angle about z."""
    phase, rotation = _carried(twist), np.eye(3)
    for _ in range(parts):
        rotation = phase.turned(rotation, 1.0 / parts)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    assert np.arctan2(rotation[1, 0], rotation[0, 0]) == pytest.approx(twist, abs=1e-14)


def test_a_step_carries_no_point_farther_than_allowed() -> None:
    """Centre and rim together: |shift| + angle r times the longest step is the largest way."""
    phase = _carried(0.5)
    assert phase.longest(1e3) * (5e-4 + 0.5 * 2e-3) == pytest.approx(5e-5)
    assert phase.load_at(0.3) is None
    assert _carried(0.5, load_n=2.0).load_at(0.3) == 2.0


def test_depth_and_force_go_straight_down() -> None:
    """A newton takes 1/k of way; both ends are met to their rounding."""
    depth = Phase(goal="1 mm", start=0.0, end=1e-3, exact=1e-14, step_max_m=5e-5)
    force = ForcePhase(goal="2 N", start=0.0, end=2.0, exact=2e-12, step_max_m=5e-5)
    np.testing.assert_array_equal(depth.rate(400.0)[0], [0.0, 0.0, -1.0])
    np.testing.assert_allclose(force.rate(400.0)[0], [0.0, 0.0, -1.0 / 400.0])
    assert force.longest(400.0) == pytest.approx(400.0 * 5e-5)
    assert force.load_at(1.5) == 1.5
    assert depth.is_short_of(1e-3 - 1e-12)
    assert not depth.is_short_of(1e-3 + 1e-15)


PUNCH = Cylinder(diameter_m=4e-3, fillet_m=0.3e-3)


@pytest.fixture(scope="module")
def path() -> LoadingPath:
    """Return a path into a coarse pad; every search goes on from the last."""
    mesh = revolved_mesh(
        DiscPad(radius_m=6e-3, height_m=4e-3),
        Grading(start_m=1.7e-3, end_m=2e-3, size_m=0.5e-3, growth=2.0),
        centre_m=(0.0, 0.0),
        sector_count=8,
        name="test",
    )
    model = Model(
        mesh, order=ElementOrder.P2, law=law(LawName.STABLE_NEO_HOOKEAN), young_pa=3e5, poisson=0.45
    )
    return LoadingPath(model, PUNCH)


@settings(max_examples=8, deadline=None, derandomize=True)
@given(force_n=st.floats(min_value=0.05, max_value=0.9))
def test_any_force_is_met_from_anywhere(path: LoadingPath, force_n: float) -> None:
    """Up or down from the last point, within the tolerance and in few evaluations."""
    match = find_force(path, force_n, tolerance_n=1e-3)
    assert abs(match.point.force_n[2] - force_n) <= 1e-3
    assert len(match.history) <= 12
    assert match.history[-1] == (match.point.depth_m, match.point.force_n[2])


def test_force_and_depth_are_the_same_path(path: LoadingPath) -> None:
    """Pressing to the depth that a search found gives its force."""
    match = find_force(path, 0.6, tolerance_n=1e-3)
    again = LoadingPath(path.model, PUNCH).advance(match.point.depth_m)
    assert again.force_n[2] == pytest.approx(match.point.force_n[2], rel=1e-4)


BALL = "--pad box:10x10x4mm --young 0.2MPa --poisson 0.48 --preset fast --indenter sphere:diameter="


def test_a_contact_faces_the_gel_where_it_presses_from_outside() -> None:
    """By hand: forces along the outward normal press; friction may lean them, a pull may not."""
    outward = np.array([[[0.0, 0.0, 2.0], [0.0, 0.0, 3.0]]])
    pressing = np.array([[[0.0, 0.0, 1.0], [0.4, 0.0, 1.0]]])
    assert faces_gel(pressing, outward, friction=0.0)
    assert not faces_gel(-pressing, outward, friction=0.0)
    leaning = np.array([[[1.0, 0.0, 1.0], [1.0, 0.0, 1.0]]]) * [1.5, 1.0, 1.0]
    assert not faces_gel(leaning, outward, friction=0.0)
    assert faces_gel(leaning, outward, friction=1.5)


def test_a_small_ball_stays_outside_of_a_coarse_gel() -> None:
    """Deeper there is more force; it passed through the surface, and felt -0.0135 N there."""
    scene = replace(scene_from(f"{BALL}1mm --depth 1.0mm"), refinement=0.6)
    path = path_for(scene, full_plan(scene))
    above, below = (float(path.advance(depth).force_n[2]) for depth in (0.9e-3, 1.0e-3))
    assert below > above > 0.0


def test_a_depth_beyond_the_base_is_refused_before_anything_is_solved() -> None:
    """A tilted punch's rim reaches it before its middle."""
    path = LoadingPath(small_model(), Sphere(diameter_m=4e-3))
    with pytest.raises(ConfigError, match="at its base"):
        path.advance(4.1e-3)
    assert path.last is None
    reach = np.array([[-9e-3, -9e-3], [9e-3, 9e-3]])
    punch, tilt = Cylinder(diameter_m=5e-3), math.radians(10.0)
    depth = base_depth_m(punch, tilted(tilt, 0.0), reach_m=reach, touch_m=4e-3, from_m=4e-3)
    assert depth == pytest.approx(4e-3 - 2.5e-3 * math.sin(tilt), abs=0.03e-3)


def test_a_force_far_beyond_the_gel_is_refused_before_meshing() -> None:
    """The remedy is less force; the estimate is named."""
    with pytest.raises(ConfigError, match="more than the gel can carry") as caught:
        press(scene_from(f"{BALL}4mm --force 1000N"))
    assert "less force" in caught.value.remedy


def test_a_press_ends_at_its_time_limit() -> None:
    """Wherever it is; the message says so."""
    with pytest.raises(TimeLimitError, match="time limit of 1e-06 s"):
        press(scene_from(f"{BALL}4mm --force 1N"), time_limit_s=1e-6)
