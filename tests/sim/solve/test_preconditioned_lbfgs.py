"""Equilibria with a factor that is kept, against Newton's method."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.effects.plan import plan_effects
from sim.effects.presets import LIGHT, build_model, light_resolution
from sim.press import keeps_factors, path_for
from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.scene.material import Material
from sim.scene.pad import DiscPad
from sim.scene.scene import ContactMode, Motion, Preset, Scene, Target
from sim.solve import preconditioned_lbfgs
from sim.solve.load_steps.path import LoadingPath
from sim.solve.model import Model
from sim.solve.newton import NewtonOptions
from sim.solve.preconditioned_lbfgs import LimitedMemory, NodalForces

PUNCH = Cylinder(diameter_m=4e-3, fillet_m=0.3e-3)
BALL = Sphere(diameter_m=10e-3)
SCENE = Scene(
    pad=DiscPad(radius_m=8e-3, height_m=4e-3),
    material=Material(young_pa=0.4e6, poisson=0.45),
    indenter=PUNCH,
    target=Target(depth_m=0.4e-3),
    preset=Preset.FAST,
    refinement=0.6,
)
DEPTHS = 0.4e-3 * np.arange(1, 9) / 8


@pytest.fixture(scope="module")
def model() -> Model:
    """Return the pad under the punch."""
    return build_model(SCENE)


@pytest.mark.parametrize("indenter", [PUNCH, BALL])
def test_it_finds_what_newton_finds_with_fewer_factors(indenter: Indenter) -> None:
    """The same forces to 1e-5, in balance, no more than two factors a frame."""
    scene = replace(SCENE, indenter=indenter)
    quick = path_for(scene, plan_effects(scene))
    exact = LoadingPath(quick.model, indenter)
    for depth in DEPTHS:
        one, other = (path.advance(float(depth)) for path in (quick, exact))
        assert one.force_n[2] == pytest.approx(other.force_n[2], rel=1e-5)
        assert one.depth_m == pytest.approx(depth, rel=1e-9)
        reaction = one.equilibrium.elastic_gradient[quick.model.clamped].sum(axis=0)
        whole = quick.model.mesh.symmetry.whole_force(reaction)
        assert whole[2] == pytest.approx(one.force_n[2], rel=2e-6)
        assert one.equilibrium.min_jacobian == pytest.approx(
            other.equilibrium.min_jacobian, rel=1e-3
        )
    found = quick.lbfgs_solver
    assert found is not None
    assert 0 < found.factorisations <= 2 * len(DEPTHS)
    assert found.evaluations < 40 * len(DEPTHS)


@pytest.mark.parametrize("indenter", [PUNCH, BALL])
def test_finer_presets_find_what_newton_finds(indenter: Indenter) -> None:
    """To a residual of 1e-8 and with a narrow barrier the forces are alike to 1e-7."""
    scene = replace(SCENE, indenter=indenter, preset=Preset.BALANCED, refinement=0.5)
    quick = path_for(scene, plan_effects(scene))
    exact = LoadingPath(quick.model, indenter)
    for depth in (0.2e-3, 0.4e-3):
        one, other = (path.advance(depth) for path in (quick, exact))
        assert one.force_n[2] == pytest.approx(other.force_n[2], rel=1e-7)
        assert one.equilibrium.residual_n <= 1e-8 * one.force_n[2]
    assert quick.lbfgs_solver is not None
    assert quick.lbfgs_solver.factorisations < exact.counts.newton_iterations


def test_the_papers_preset_is_left_to_newton() -> None:
    """Its linear element and its barrier are the paper's, and so is its method."""
    paper = replace(SCENE, preset=Preset.PAPER)
    assert paper.is_smooth
    assert not keeps_factors(paper, build_model(SCENE))


@pytest.mark.parametrize(
    ("refinement", "count"), [(0.62, 8), (0.9, 12), (1.0, 16), (1.8, 16), (2.2, 20), (3.3, 24)]
)
def test_the_sectors_of_a_light_mesh_become_more_with_the_root(
    refinement: float, count: int
) -> None:
    """Its edges in the section are what is refined; preset fast is as it is."""
    found = light_resolution(refinement)
    assert found.sector_count == count
    assert found.smooth_share == pytest.approx(LIGHT.smooth_share / refinement)
    assert light_resolution(1.0) == LIGHT


def test_a_load_is_met(model: Model) -> None:
    """One push after the other on one path; the depth is that of the press to that depth."""
    path = path_for(SCENE, plan_effects(SCENE), model=model)
    for force in (0.3, 0.9):
        assert path.push(force).force_n[2] == pytest.approx(force, rel=1e-7)
    again = path_for(SCENE, plan_effects(SCENE), model=model)
    pressed = again.advance(path.push(0.9).depth_m)
    assert pressed.force_n[2] == pytest.approx(0.9, rel=1e-5)


def test_it_goes_back_the_way_it_came(model: Model) -> None:
    """Retracted, the gel pushes as it did on the way in."""
    path = path_for(SCENE, plan_effects(SCENE), model=model)
    before = [float(path.advance(depth).force_n[2]) for depth in (0.15e-3, 0.3e-3)]
    assert path.advance(0.15e-3).force_n[2] == pytest.approx(before[0], rel=1e-5)


def test_newton_takes_over_where_it_gives_up(model: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    """Allowed no step at all, the press is Newton's from end to end."""
    monkeypatch.setattr(preconditioned_lbfgs, "_STEPS_MAX", 0)
    found = path_for(SCENE, plan_effects(SCENE), model=model).advance(0.1e-3)
    exact = LoadingPath(model, PUNCH).advance(0.1e-3)
    assert found.force_n[2] == pytest.approx(exact.force_n[2], rel=1e-5)
    assert found.equilibrium.residual_n <= 1e-5 * found.force_n[2]


def test_forces_are_those_of_the_model(model: Model) -> None:
    """Gel and contact, their sum on the indenter and the smallest gap, at any state."""
    path = LoadingPath(model, PUNCH, options=NewtonOptions(residual_relative=1e-4))
    state = path.advance(0.2e-3).state
    forces = NodalForces(model, PUNCH, extension=state.extension)
    for lift in (0.0, -10e-6, 1.0):
        state.tip[2] += lift
        contact = model.surface.forces(state.positions, PUNCH, state)
        elastic = model.gel.gradient(state.positions)
        expected = elastic + model.surface.scatter(contact.forces)
        np.testing.assert_allclose(forces.gradient(state), expected, atol=1e-12)
        np.testing.assert_allclose(forces.push, contact.forces.sum(axis=(0, 1)), atol=1e-12)
        gaps = model.surface.gaps(state.positions, PUNCH, state)
        touching = gaps[gaps < SCENE.contact_distance_m]
        assert forces.gap[0] == pytest.approx(touching.min(initial=np.inf))


@pytest.mark.parametrize(
    "changed",
    [
        replace(SCENE, contact=ContactMode.BONDED),
        replace(SCENE, motion=Motion(shift_m=(0.1e-3, 0.0))),
        replace(SCENE, indenter=Cylinder(diameter_m=4e-3)),
        replace(SCENE, preset=Preset.BALANCED),
    ],
)
def test_other_scenes_are_left_to_newton(changed: Scene) -> None:
    """Friction, motion, a sharp rim or another preset: no kept factor, and a narrow barrier."""
    assert SCENE.is_light
    assert not changed.is_light
    assert changed.contact_distance_m < SCENE.contact_distance_m


@given(seed=st.integers(0, 10_000), pairs=st.integers(1, 6))
def test_the_last_step_is_foretold(seed: int, pairs: int) -> None:
    """Minus the inverse times the last change is minus the last step, whatever the inverse."""
    random = np.random.default_rng(seed)
    root = random.normal(size=(8, 8))
    hessian = root @ root.T + np.eye(8)
    scales = random.uniform(0.1, 10.0, size=8)
    memory = LimitedMemory(4)
    for _ in range(pairs):
        step = random.normal(size=8)
        memory.learn(step, hessian @ step)
    found = memory.direction(hessian @ step, lambda right: scales * right)
    np.testing.assert_allclose(found, -step, rtol=1e-7, atol=1e-9)


def test_without_memory_it_is_the_inverse_alone() -> None:
    """Nothing learnt, all forgotten, or a step along no curvature: the inverse decides."""
    gradient = np.array([1.0, -2.0, 4.0])
    memory = LimitedMemory(3)
    memory.learn(np.array([1.0, 0.0, 0.0]), np.array([2.0, 0.0, 0.0]))
    memory.forget()
    memory.learn(np.array([1.0, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0]))
    np.testing.assert_array_equal(memory.direction(gradient, lambda r: 0.5 * r), -0.5 * gradient)
    np.testing.assert_array_equal(gradient, [1.0, -2.0, 4.0])
