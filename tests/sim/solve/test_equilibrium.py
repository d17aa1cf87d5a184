"""Equilibria, and with a factor that is kept, against Newton's method."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import warp as wp

from sim.contact.surface_and_grip import State
from sim.device import on_host
from sim.effects.effect_choice import plan_effects
from sim.effects.presets import LIGHT, build_model, light_resolution
from sim.effects.press_with_effects import follow, path_for
from sim.mesh.elements import ElementOrder
from sim.press_arguments import scene_from
from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.scene.material import Layer, Material
from sim.scene.pad import DiscPad
from sim.scene.scene import ContactMode, Effect, Motion, Preset, Scene, Target
from sim.solve import equilibrium
from sim.solve.equilibrium import NEWTON, EquilibriumSolver, SolverOptions
from sim.solve.line_search_and_convergence import note_residual, stagnates
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model
from sim.studies.hard_cases.small_pads import brick_mesh, pad_model
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConvergenceError


@wp.kernel(enable_backward=False, module="unique")
def _noted(
    history: wp.array(dtype=wp.float64),
    last: wp.array(dtype=wp.float64),
    still_out: wp.array(dtype=wp.bool),
):
    for k in range(history.shape[0]):
        note_residual(last, history[k])
        still_out[k] = stagnates(last, k + 1)


def _stand_still(residuals: list[float]) -> list[bool]:
    """Return after which residuals they stood still."""
    history = wp.array(residuals, dtype=wp.float64, device="cpu")
    last = wp.zeros(6, dtype=wp.float64, device="cpu")
    found = wp.zeros(len(residuals), dtype=wp.bool, device="cpu")
    wp.launch(_noted, 1, [history, last, found], device="cpu")
    return found.numpy().tolist()


@pytest.mark.parametrize("rate", [0.5, 0.8, 0.9, 0.95, 0.97])
def test_linear_convergence_is_no_standstill(rate: float) -> None:
    """A residual that shrinks steadily, however slowly, is left to."""
    assert not any(_stand_still([rate**k for k in range(100)]))


@pytest.mark.parametrize("noise", [[1.0], [1.0, 2.0], [1.2, 0.95, 3.0], [1.0, 1.1, 0.92, 1.4]])
def test_noise_is_a_standstill(noise: list[float]) -> None:
    """A residual that goes up and down about one value stands still, after some iterations."""
    assert any(_stand_still([1e6, 1e3, *(noise * 12)[:12]]))


def test_rounding_is_a_standstill_that_is_taken_and_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Asked for nothing at all, Newton ends in rounding, stalled, with the force of any press."""
    model = pad_model(brick_mesh((3, 3, 2), quarter=True), order=ElementOrder.P1)
    forces, stalled = [], []
    for options in (SolverOptions(), SolverOptions(residual_relative=0.0)):
        path = LoadingPath(model, Sphere(diameter_m=6e-3), options=options)
        point = path.advance(0.2e-3)
        forces.append(point.force_n[2])
        stalled.append(point.equilibrium.stalled)
        monkeypatch.setattr(equilibrium, "_FLOOR_SHARE", 0.0)
        assert point.equilibrium.residual_n <= 1e-8 * point.force_n[2]
    assert stalled == [False, True]
    assert forces[1] == pytest.approx(forces[0], rel=1e-8)


def test_what_would_do_harm_is_an_error_after_the_last_iteration() -> None:
    """Out of iterations far from equilibrium: the message has their number and the residual."""
    model = pad_model(brick_mesh((3, 3, 2), quarter=True), order=ElementOrder.P1)
    path = LoadingPath(model, Sphere(diameter_m=6e-3))
    state = model.rest_state(tip=np.array([0.0, 0.0, path.touch_m - 0.5e-3]))
    with pytest.raises(ConvergenceError, match=r"after 2 steps: residual .* N at a"):
        path.solver.settle(state, options=SolverOptions(iteration_max=2))


def test_a_point_in_a_corner_rests_where_its_force_jumps() -> None:
    """Between a cross's two nearest sides no step brings the residual down, and it is taken."""
    words = "--sensor gelsight-mini --indenter object:cross --depth 0.424mm --preset fast"
    scene = scene_from(f"{words} --at -6.62,4.74mm --tilt -0.21,-1.13deg")
    path = path_for(scene := replace(scene, refinement=0.3, tolerance=0.5), plan_effects(scene))
    path.options = replace(path.options, residual_relative=1e-4)
    point = follow(scene, path)
    size = float(np.linalg.norm(point.force_n))
    assert point.equilibrium.stalled
    assert point.equilibrium.residual_n < 1e-3 * size
    reaction = point.equilibrium.elastic_gradient[path.model.clamped].sum(axis=0)
    assert reaction == pytest.approx(point.force_n, abs=1e-3 * size)
    assert path.solver.evaluations < 1000


PUNCH = Cylinder(diameter_m=4e-3, fillet_m=0.3e-3)
BALL = Sphere(diameter_m=10e-3)
GEL = Material(young_pa=0.4e6, poisson=0.45)
SCENE = Scene(
    pad=DiscPad(radius_m=8e-3, height_m=4e-3),
    material=GEL,
    indenter=PUNCH,
    target=Target(depth_m=0.4e-3),
    preset=Preset.FAST,
    refinement=0.6,
)
RUBBED = {"contact": ContactMode.FRICTION, "effects": ((Effect.FRICTION, True),)}
DEPTHS = 0.4e-3 * np.arange(1, 9) / 8


@pytest.fixture(scope="module")
def model() -> Model:
    """Return the pad under the punch."""
    return build_model(SCENE)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"indenter": BALL},
        {"indenter": BALL, **RUBBED},
        {"layers": (Layer(share=0.5, material=GEL), Layer(share=0.5, material=GEL))},
        {"contact": ContactMode.BONDED},
        {"indenter": BALL, "preset": Preset.BALANCED, "refinement": 0.4},
    ],
)
def test_it_finds_what_newton_finds_with_fewer_factors(changes: dict[str, object]) -> None:
    """The same forces to 1e-5, in balance, with less than half of the factors."""
    scene = replace(SCENE, **changes)  # type: ignore[arg-type]
    kept = path_for(scene, plan_effects(scene))
    newton = LoadingPath(kept.model, scene.indenter, reuse=NEWTON)
    for depth in DEPTHS:
        one, other = (path.advance(float(depth)) for path in (kept, newton))
        assert one.force_n[2] == pytest.approx(other.force_n[2], rel=1e-5)
        assert one.depth_m == pytest.approx(depth, rel=1e-9)
        reaction = one.equilibrium.elastic_gradient[kept.model.clamped].sum(axis=0)
        whole = kept.model.mesh.symmetry.whole_force(reaction)
        assert whole[2] == pytest.approx(one.force_n[2], rel=2e-6)
    assert 0 < kept.solver.factor.made < 0.5 * newton.solver.factor.made


@pytest.mark.parametrize("indenter", [PUNCH, BALL])
def test_a_slide_finds_what_newton_finds(indenter: Indenter) -> None:
    """Carried along with friction, both forces are alike, and so is the drag."""
    scene = replace(SCENE, indenter=indenter, motion=Motion(shift_m=(0.1e-3, 0.0)), **RUBBED)  # type: ignore[arg-type]
    kept = path_for(scene, plan_effects(scene))
    paths = kept, LoadingPath(kept.model, indenter, reuse=NEWTON)
    forces = []
    for path in paths:
        path.options = SolverOptions()
        path.advance(0.2e-3)
        forces.append(path.carry(shift_m=(0.1e-3, 0.0)).force_n)
    assert forces[0] == pytest.approx(forces[1], rel=2e-3, abs=1e-3 * forces[1][2])
    assert forces[0][0] < 0.0


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


def test_a_factor_that_hardly_holds_the_ball_lowers_it_by_little(
    model: Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A step that would take it down by a metre ends in the pad, not beyond it."""
    path = path_for(replace(SCENE, indenter=BALL), plan_effects(SCENE), model=model)
    solver, state = path.solver, path.advance(0.1e-3).state

    def down_by_a_metre(_asked: object, _sources: object, found: Any, prepare: Any) -> None:
        prepare()
        found.numpy()[0, :-1], found.numpy()[0, -1] = 0.0, -1.0

    monkeypatch.setattr(solver.factor, "apply", down_by_a_metre)
    descents, before = solver._descents, state.tip[2]
    solver.factor.held = False
    descents.begin(
        pushed=1,
        load=1.0,
        relative=path.options.residual_relative,
        floor=0.0,
        steps_max=path.options.iteration_max,
        gap_least=0.0,
        rounding=-1.0,
        checked=1,
        rough=0,
    )
    descents.place(state, grip_start=state.grip)
    descents.step()
    assert 0.0 < before - descents.poses.tips.numpy()[0, 2] < 0.05 * model.height_m


def test_it_goes_back_the_way_it_came(model: Model) -> None:
    """Retracted, the gel pushes as it did on the way in."""
    path = path_for(SCENE, plan_effects(SCENE), model=model)
    before = [float(path.advance(depth).force_n[2]) for depth in (0.15e-3, 0.3e-3)]
    assert path.advance(0.15e-3).force_n[2] == pytest.approx(before[0], rel=1e-5)


def _evaluated(
    solver: EquilibriumSolver, state: State
) -> tuple[FloatArray, FloatArray, float, FloatArray]:
    """Return the gel's and contact's gradients [N], energy [J] and gaps [m] that descents find."""
    descents = solver._descents
    descents.place(state, grip_start=state.grip)
    descents.set(wanted=1)
    descents.evaluate()
    elastic, energies, _ratios = (on_host(each)[0] for each in descents.gel_buffers)
    contact, touched, gaps = (on_host(each)[0] for each in descents.contact_buffers)
    return elastic, contact, float(energies.sum() + touched.sum()), gaps


def test_forces_are_those_of_the_model(model: Model) -> None:
    """Gel and contact, their sum on the indenter, energy and gaps, at any state."""
    path = LoadingPath(model, PUNCH, options=SolverOptions(residual_relative=1e-4))
    state = path.advance(0.2e-3).state
    for lift in (0.0, -10e-6, 1.0):
        state.tip[2] += lift
        contact = model.surface.forces(state.positions, PUNCH, state)
        elastic = model.gel.gradient(state.positions)
        elastic_n, contact_n, energy_j, gaps_m = _evaluated(path.solver, state)
        expected = elastic + model.surface.scatter(contact.forces)
        np.testing.assert_allclose(elastic_n + contact_n, expected, atol=1e-12)
        np.testing.assert_allclose(
            contact_n.sum(axis=0), contact.forces.sum(axis=(0, 1)), atol=1e-12
        )
        gaps = model.surface.gaps(state.positions, PUNCH, state)
        np.testing.assert_allclose(gaps_m, gaps, atol=1e-15)
        stored = model.surface.energy(state.positions, PUNCH, state)
        whole = model.gel.energy(state.positions)[0] + stored
        assert energy_j == pytest.approx(whole, rel=1e-12)


@pytest.mark.parametrize(
    "changed", [replace(SCENE, contact=ContactMode.BONDED), replace(SCENE, preset=Preset.BALANCED)]
)
def test_what_sticks_keeps_a_narrow_barrier(changed: Scene) -> None:
    """So does every preset but fast."""
    assert SCENE.has_wide_barrier
    assert not changed.has_wide_barrier
    assert changed.contact_distance_m < SCENE.contact_distance_m
