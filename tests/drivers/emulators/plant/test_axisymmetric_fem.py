"""The gel's finite elements against solutions that other methods and other people found."""

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from drivers.emulators.plant.axisymmetric_fem import (
    PENALTY_PER_M,
    STICK_PER_M,
    Equilibrium,
    GelSolver,
    NeoHookean,
    Springs,
    TiltResponse,
    assembled,
    solved,
    tilt_response,
)
from drivers.emulators.plant.quad_mesh import Grading, mesh_disc
from drivers.emulators.plant.truth import CylinderTip, GelDisc, SphereTip
from tacauchy_rig.core.arrays import FloatArray, Int64Array
from tacauchy_rig.core.errors import ConvergenceError

PUNCH_RADIUS = 2.5e-3
LAYER = GelDisc(radius_m=12e-3, thickness_m=4.5e-3, dome_radius_m=math.inf)
RIM = Grading(fine_from_m=2.3e-3, fine_to_m=2.7e-3, fine_size_m=1e-4)


class BondedPunch(GelSolver):
    """A patch of the top that is glued to a punch: the reference solutions' other way to press."""

    def press_tied(self, patch: Int64Array, depth_m: float, start: FloatArray) -> tuple[float, Any]:
        """Return the reaction over Young's modulus [m^2] and the displacement [m]."""
        self._tip_z_m = 1.0  # far above
        held = np.union1d(self._clamped, np.concatenate([2 * patch, 2 * patch + 1]))
        u = start.ravel()
        step = np.zeros_like(u)
        step[2 * patch], step[2 * patch + 1] = -u[2 * patch], -depth_m - u[2 * patch + 1]
        free = np.setdiff1d(np.arange(u.size), held)
        # The rest follows linearly first, so that no element is turned inside out.
        residual, stiffness = self._linearise(u)
        step += solved(stiffness, -(residual + stiffness @ step), free)
        solution = self._newton(u + step, held)
        reaction = float(self._linearise(solution)[0][2 * patch + 1].sum())
        return -reaction, solution.reshape(-1, 2)


def test_bonded_punch_agrees_with_two_other_codes() -> None:
    """Finite strain, E 0.3 MPa, nu 0.45: felupe 11.3 and CalculiX 2.20, extrapolated in h."""
    reference = {0.1e-3: 0.36350, 0.3e-3: 1.11033, 0.6e-3: 2.29093}  # depth [m]: force [N]
    coarse = Grading(fine_from_m=2.3e-3, fine_to_m=2.7e-3, fine_size_m=4e-5)
    mesh = mesh_disc(LAYER, coarse)
    solver = BondedPunch(mesh, SphereTip(diameter_m=1e-3), poisson=0.45)
    top = np.unique(mesh.top_edges)
    patch = top[mesh.nodes[top, 0] <= PUNCH_RADIUS + 1e-9]
    state = np.zeros_like(mesh.nodes)
    for depth in (0.1e-3, 0.2e-3, 0.3e-3, 0.4e-3, 0.5e-3, 0.6e-3):
        force, state = solver.press_tied(patch, depth, state)
        if depth in reference:
            assert force * 0.3e6 == pytest.approx(reference[depth], rel=0.008)


@pytest.mark.parametrize(("poisson", "kappa"), [(0.45, 1.930), (0.49, 2.048)])
def test_flat_punch_agrees_with_the_finite_layer(poisson: float, kappa: float) -> None:
    """F = 2 a E d kappa / (1 - nu^2), frictionless, a/h = 0.5556 (Hayes et al. 1972)."""
    wide = GelDisc(radius_m=24e-3, thickness_m=4.5e-3, dome_radius_m=math.inf)
    sharp = Grading(fine_from_m=2.4e-3, fine_to_m=2.6e-3, fine_size_m=1e-5, top_size_m=1e-5)
    tip = CylinderTip(diameter_m=2 * PUNCH_RADIUS, fillet_m=0.0)
    solver = GelSolver(mesh_disc(wide, sharp), tip, poisson=poisson)
    depth = 5e-6
    found = solver.press(wide.thickness_m - depth, np.zeros_like(solver.mesh.nodes))
    expected = 2 * PUNCH_RADIUS * depth * kappa / (1 - poisson**2)
    assert found.force == pytest.approx(expected, rel=0.005)
    assert found.contact_radius_m == pytest.approx(PUNCH_RADIUS, rel=0.01)


def test_small_ball_agrees_with_hertz() -> None:
    """F = 4/3 E/(1 - nu^2) sqrt(R) d^(3/2) while the contact is small against the layer."""
    grading = Grading(fine_from_m=0.0, fine_to_m=0.2e-3, fine_size_m=1e-5, top_size_m=1e-5)
    solver = GelSolver(mesh_disc(LAYER, grading), SphereTip(diameter_m=2e-3), poisson=0.45)
    state = np.zeros_like(solver.mesh.nodes)
    for depth in (1e-6, 3e-6):
        found = solver.press(LAYER.thickness_m - depth, state)
        state = found.displacement
    hertz = 4 / 3 / (1 - 0.45**2) * math.sqrt(1e-3) * depth**1.5
    assert found.force == pytest.approx(hertz, rel=0.015)
    assert found.contact_radius_m == pytest.approx(math.sqrt(1e-3 * depth), rel=0.05)


def test_out_of_contact_nothing_moves_and_a_hopeless_step_is_refused() -> None:
    """A tip above the gel leaves it as it was; one through the base ends in a message."""
    solver = GelSolver(mesh_disc(LAYER, RIM), CylinderTip(diameter_m=5e-3), poisson=0.48)
    rest = np.zeros_like(solver.mesh.nodes)
    found = solver.press(LAYER.thickness_m + 1e-6, rest)
    assert found.force == 0.0
    assert not found.displacement.any()
    with pytest.raises(ConvergenceError, match="emulated gel"):
        solver.press(1e-4, rest)


DOWN = np.tile([0.0, -1.0], (3, 1))
LIMIT = np.array([0.1, 0.2, 0.0])


def _at(radius: float) -> np.ndarray:
    return np.column_stack([np.full(3, radius), np.zeros(3)])


def test_what_is_drawn_beyond_its_limit_slips() -> None:
    """A spring pulls as far as it is drawn, and no further than friction times pressure."""
    springs = Springs(None, _at(0.0), DOWN, LIMIT)
    drawn = 0.15 / STICK_PER_M
    pull, _ = springs.linearised(_at(drawn))
    assert np.abs(pull[:, 0]) == pytest.approx([0.1, 0.15, 0.0])
    assert list(springs.sticks(_at(drawn))) == [0.0, 1.0, 0.0]


def test_pull_and_stiffness_are_derivatives_of_the_energy() -> None:
    """Newton's method has a line search: central differences agree on both sides of slipping."""
    springs = Springs(None, _at(0.0), DOWN, LIMIT)
    step = 1e-12
    for place in (0.05 / STICK_PER_M, 0.5 / STICK_PER_M):
        slope = (springs.energy(_at(place + step)) - springs.energy(_at(place - step))) / (2 * step)
        assert slope == pytest.approx(springs.linearised(_at(place))[0][:, 0], abs=1e-5)


def test_a_grip_is_remembered() -> None:
    """Going back from a slip releases the spring, then draws it the other way."""
    first = Springs(None, _at(0.0), DOWN, LIMIT)
    slipped = first.drawn(_at(1.0 / STICK_PER_M), LIMIT)
    back = Springs(slipped, _at(1.0 / STICK_PER_M), DOWN, LIMIT)
    pull, _ = back.linearised(_at(0.9 / STICK_PER_M))
    assert pull[:, 0] == pytest.approx([0.0, 0.1, 0.0], abs=1e-9)


REST = np.eye(3).ravel()


@given(arrays(np.float64, 9, elements=st.floats(-0.15, 0.15)), st.floats(0.3, 0.495))
def test_stress_and_tangent_are_derivatives(change: np.ndarray, poisson: float) -> None:
    """Stress is the energy's gradient and the tangent the stress's, at any deformation."""
    law, step = NeoHookean(poisson=poisson), 1e-6
    stress, tangent = law.linearised(REST + change)
    for i, shift in enumerate(step * np.eye(9)):
        low, high = REST + change - shift, REST + change + shift
        assert stress[i] == pytest.approx((law.energy(high) - law.energy(low)) / 2e-6, abs=1e-5)
        column = (law.linearised(high)[0] - law.linearised(low)[0]) / 2e-6
        np.testing.assert_allclose(tangent[:, i], column, atol=1e-4)


def test_rest_is_stress_free_and_small_strain_is_hooke() -> None:
    """Uniaxial tension gives Young's modulus one; the paper's printed law has stress at rest."""
    law, strain = NeoHookean(poisson=0.48), 1e-6
    np.testing.assert_allclose(law.linearised(REST)[0], 0.0, atol=1e-15)
    pulled, _ = law.linearised(REST + strain * np.diag([-0.48, -0.48, 1.0]).ravel())
    assert pulled[8] / strain == pytest.approx(1.0, rel=1e-4)
    assert pulled[0] / strain == pytest.approx(0.0, abs=1e-3)
    # An inverted element is refused by its energy, so that a line search backs off.
    assert law.energy(np.diag([-1.0, 1.0, 1.0]).ravel()) == np.inf


def test_the_base_carries_what_the_tip_presses() -> None:
    """Friction on a ball's slopes is a part of the force along its axis, here 6 %."""
    grading = Grading(fine_from_m=0.0, fine_to_m=1.5e-3, fine_size_m=1e-4, top_size_m=1e-4)
    solver = GelSolver(
        mesh_disc(LAYER, grading), SphereTip(diameter_m=5e-3), poisson=0.48, friction=0.5
    )
    found = Equilibrium(displacement=np.zeros_like(solver.mesh.nodes))
    for depth in (0.2e-3, 0.4e-3, 0.6e-3):
        found = solver.press(LAYER.thickness_m - depth, found.displacement, grip=found.grip)
    u = found.displacement.ravel()
    _, distance, depths = solver.contact(u)
    carried = assembled(solver._dofs, solver._elastic(u)[0], u.size)
    assert found.force == pytest.approx(carried[2 * solver.mesh.base_nodes + 1].sum(), rel=1e-6)
    pressed = PENALTY_PER_M * solver.edge_weights.ravel() @ (depths * distance.gradient[:, 1])
    assert found.force > 1.03 * pressed


TIP = CylinderTip(diameter_m=2e-3, fillet_m=5e-5)
GEL = GelDisc(radius_m=20e-3, thickness_m=20e-3, dome_radius_m=np.inf)
GRADING = Grading(fine_from_m=0.8e-3, fine_to_m=1.05e-3, fine_size_m=2.5e-5)
DEPTH_M = 1e-5


@cache
def _pressed(friction: float) -> tuple[Equilibrium, TiltResponse, float]:
    """Return a shallow press into a thick gel, its tilt, and dF/d(depth)."""
    solver = GelSolver(mesh_disc(GEL, GRADING), TIP, poisson=0.3, friction=friction)
    state = Equilibrium(displacement=np.zeros_like(solver.mesh.nodes))
    forces = []
    for depth in (0.5 * DEPTH_M, DEPTH_M):
        state = solver.press(GEL.thickness_m - depth, state.displacement, grip=state.grip)
        forces.append(state.force)
    tilt = tilt_response(solver, state)
    return state, tilt, (forces[1] - forces[0]) / (0.5 * DEPTH_M)


def test_a_thick_gel_answers_as_a_half_space_does() -> None:
    """Rigid disc of radius a on a half-space: moment over force stiffness is 2/3 a^2 (Johnson)."""
    state, tilt, stiffness = _pressed(friction=0.0)
    radius_m = state.contact_radius_m
    assert tilt.moment == pytest.approx(2.0 / 3.0 * radius_m**2 * stiffness, rel=0.06)


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_the_gel_follows_the_face(friction: float) -> None:
    """Where the face touches, the gel goes down on the side that it tilts to, by tilt times r."""
    mesh = mesh_disc(GEL, GRADING)
    _, tilt, _ = _pressed(friction)
    top = np.unique(mesh.top_edges)
    inside = top[(mesh.nodes[top, 0] > 0.1e-3) & (mesh.nodes[top, 0] < 0.85e-3)]
    np.testing.assert_allclose(tilt.displacement[inside, 1], -mesh.nodes[inside, 0], rtol=0.03)
