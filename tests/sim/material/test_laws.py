"""Constitutive laws: derivatives, invariance, and the paper's printed one."""

from functools import cache
from typing import Any

import numpy as np
import pytest
import warp as wp

from sim.material.laws.law_and_lame import Law, block_of, law
from sim.material.laws.paper_eq4 import free_stretch
from sim.mesh.elements import ElementOrder
from sim.mesh.mirror_symmetry import MirrorSymmetry
from sim.scene.indenter import Sphere
from sim.scene.material import LawName
from sim.solve.equilibrium import SolverOptions
from sim.solve.loading_path import LoadingPath, unloaded_positions
from sim.solve.model import Model
from tacauchy_rig.core.arrays import FloatArray
from tests.sim.material.small_disc import PAD, disc_model, matrix

YOUNG_PA, POISSON = 4e5, 0.45
MU_PA = YOUNG_PA / (2.0 * (1.0 + POISSON))
LAMBDA_PA = YOUNG_PA * POISSON / ((1.0 + POISSON) * (1.0 - 2.0 * POISSON))
# Central differences over so much leave 4e-10 of what they are of.
_STEP = 1e-6


_Rows = wp.types.vector(length=9, dtype=wp.float64)


@cache
def _kernel(law: Law) -> Any:
    energy, stress, tangent = law.energy, law.stress, law.tangent

    @wp.kernel(enable_backward=False, module="unique")
    def evaluate(
        deformations: wp.array(dtype=wp.mat33d),
        parameters: wp.vec4d,
        g: wp.vec3d,
        h: wp.vec3d,
        energies_out: wp.array(dtype=wp.float64),
        stresses_out: wp.array(dtype=wp.mat33d),
        blocks_out: wp.array(dtype=_Rows),
    ):
        i = wp.tid()
        F = deformations[i]
        energies_out[i] = energy(F, parameters)
        stresses_out[i] = stress(F, parameters)
        t = tangent(F, parameters)
        blocks_out[i] = block_of(t, g) * h

    return evaluate


def evaluated(
    law: Law, deformations: FloatArray, g: FloatArray, h: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return energy densities [J/m^3], first Piola-Kirchhoff stresses [Pa] and tangent blocks [Pa].

    Args:
        deformations: F, shape [count, 3, 3].
        g: Shape gradient of the rows' node, as ``block_of`` takes it.
        h: Shape gradient of the columns' node.
    """
    count = len(deformations)
    kinds = (wp.float64, wp.mat33d, _Rows)
    out = [wp.zeros(count, dtype=kind, device="cpu") for kind in kinds]
    given = wp.array(np.ascontiguousarray(deformations), dtype=wp.mat33d, device="cpu")
    parameters = wp.vec4d(*law.parameters(YOUNG_PA, POISSON))
    inputs = [given, parameters, wp.vec3d(*g), wp.vec3d(*h)]
    wp.launch(_kernel(law), dim=count, inputs=inputs, outputs=out, device="cpu")
    energies, stresses, blocks = (array.numpy() for array in out)
    return energies, stresses, blocks.reshape(-1, 3, 3)


def energy(law: Law, F: FloatArray) -> float:
    """Return the energy density at one F [J/m^3]."""
    return float(evaluated(law, F[None], np.zeros(3), np.zeros(3))[0][0])


def stress(law: Law, F: FloatArray) -> FloatArray:
    """Return the first Piola-Kirchhoff stress at one F [Pa], shape [3, 3]."""
    return np.asarray(evaluated(law, F[None], np.zeros(3), np.zeros(3))[1][0])


def deformed() -> FloatArray:
    """Return deformation gradients of up to 30 % strain in any direction, shape [20, 3, 3]."""
    rng = np.random.default_rng(11)
    return np.asarray(np.eye(3) + rng.uniform(-0.3, 0.3, (20, 3, 3)))


def turn() -> FloatArray:
    """Return a rotation by 1.1 rad about a skew axis, shape [3, 3]."""
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    cross = np.cross(np.eye(3), axis)
    return np.asarray(np.eye(3) + np.sin(1.1) * cross + (1.0 - np.cos(1.1)) * cross @ cross)


def derivative_errors(law: Law) -> tuple[float, float]:
    """Return how far the stress is from the energy's slope, and the tangent from the stress's.

    Both over the largest of the latter at each F, the worst of ``deformed``.
    """
    rng = np.random.default_rng(12)
    F, g, h = deformed(), rng.normal(size=3), rng.normal(size=3)
    _, stresses, blocks = evaluated(law, F, g, h)
    slopes, rates = np.zeros_like(stresses), np.zeros_like(blocks)
    for i in range(3):
        for j in range(3):
            step = np.zeros((3, 3))
            step[i, j] = _STEP
            ahead, behind = (evaluated(law, F + s * step, g, h)[0] for s in (1.0, -1.0))
            slopes[:, i, j] = (ahead - behind) / (2.0 * _STEP)
        along = np.zeros((3, 3))
        along[i] = _STEP * h
        ahead, behind = (evaluated(law, F + s * along, g, h)[1] for s in (1.0, -1.0))
        rates[:, :, i] = (ahead - behind) @ g / (2.0 * _STEP)
    return _apart(stresses, slopes), _apart(blocks, rates)


def _apart(found: FloatArray, wanted: FloatArray) -> float:
    size = np.abs(wanted).max(axis=(1, 2), keepdims=True)
    return float((np.abs(found - wanted) / size).max())


LINEAR, NEO_HOOKEAN = law(LawName.LINEAR), law(LawName.NEO_HOOKEAN)
STABLE = law(LawName.STABLE_NEO_HOOKEAN)
STRAIN = 1e-2


@pytest.mark.parametrize("name", list(LawName))
def test_stress_and_tangent_are_derivatives(name: LawName) -> None:
    """Of the energy and of the stress, by central differences."""
    assert max(derivative_errors(law(name))) < 5e-9


@pytest.mark.parametrize("objective", [NEO_HOOKEAN, STABLE], ids=lambda each: each.name)
def test_a_turn_turns_the_stress_and_costs_nothing(objective: Law) -> None:
    """Objective: psi(Q F) = psi(F), P(Q F) = Q P(F)."""
    for F in deformed():
        assert energy(objective, turn() @ F) == pytest.approx(energy(objective, F), rel=1e-9)
        still = stress(objective, F)
        apart = stress(objective, turn() @ F) - turn() @ still
        assert np.abs(apart).max() < 1e-10 * np.abs(still).max()


@pytest.mark.parametrize("usable", [NEO_HOOKEAN, STABLE], ids=lambda each: each.name)
def test_rest_is_free_of_stress_and_as_stiff_as_hookes_law(usable: Law) -> None:
    """Which the law as the paper prints it is not."""
    g, h = np.random.default_rng(2).normal(size=(2, 3))
    rest = np.eye(3)[None]
    assert energy(usable, np.eye(3)) == pytest.approx(0.0, abs=1e-12 * YOUNG_PA)
    assert np.abs(stress(usable, np.eye(3))).max() < 1e-12 * YOUNG_PA
    found, hooke = (evaluated(each, rest, g, h)[2][0] for each in (usable, LINEAR))
    assert np.abs(found - hooke).max() < 1e-12 * np.abs(hooke).max()


def test_a_bar_pulled_by_its_ends_is_as_stiff_as_e_and_thins_by_nu() -> None:
    """Hooke's law: stress E e along, none across, and the energy is half their product."""
    F = np.diag([1.0 + STRAIN, 1.0 - POISSON * STRAIN, 1.0 - POISSON * STRAIN])
    pulled = np.diag([YOUNG_PA * STRAIN, 0.0, 0.0])
    np.testing.assert_allclose(stress(LINEAR, F), pulled, atol=1e-9 * YOUNG_PA * STRAIN)
    assert energy(LINEAR, F) == pytest.approx(0.5 * YOUNG_PA * STRAIN**2, rel=1e-12)


def test_a_small_turn_is_no_strain_and_a_large_one_is() -> None:
    """Why Hooke's law is said not to be objective."""
    spin = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(stress(LINEAR, np.eye(3) + 1e-2 * spin), 0.0, atol=1e-9 * YOUNG_PA)
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert np.abs(stress(LINEAR, turned)).max() > YOUNG_PA
    assert not LINEAR.is_objective


@pytest.mark.parametrize("stretch", [0.8, 1.0, 1.3])
def test_a_change_of_size_costs_a_neo_hookean_gel_volume_alone(stretch: float) -> None:
    """Energy K/2 (J - 1)^2, pressure K (J - 1), no shear."""
    bulk, ratio = LAMBDA_PA + 2.0 / 3.0 * MU_PA, stretch**3
    pressed = bulk * (ratio - 1.0) * stretch**2 * np.eye(3)
    F = stretch * np.eye(3)
    np.testing.assert_allclose(stress(NEO_HOOKEAN, F), pressed, rtol=1e-10, atol=1e-9 * bulk)
    expected = 0.5 * bulk * (ratio - 1.0) ** 2
    assert energy(NEO_HOOKEAN, F) == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_a_change_of_shape_costs_a_neo_hookean_gel_mu_alone() -> None:
    """At J = 1 the Cauchy stress is mu dev(F F^T)."""
    F = np.diag([1.3, 1.0 / 1.3, 1.0])
    F[0, 1] = 0.2
    F[1] *= 1.0 / np.linalg.det(F)
    b = F @ F.T
    wanted = MU_PA * (b - np.trace(b) / 3.0 * np.eye(3))
    found = stress(NEO_HOOKEAN, F) @ F.T
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9 * MU_PA)


def test_a_gel_turned_inside_out_is_refused_or_pushed_back() -> None:
    """At J <= 0: no energy buys it, or energy and stress stay finite and point back to rest."""
    flat, out = np.diag([1.0, 1.0, 0.0]), np.diag([1.0, 1.0, -0.2])
    assert energy(NEO_HOOKEAN, flat) == energy(NEO_HOOKEAN, out) == np.inf
    assert 0.0 < energy(STABLE, flat) < energy(STABLE, out) < np.inf
    assert stress(STABLE, out)[2, 2] < stress(STABLE, flat)[2, 2] < 0.0


def coarse_model(name: LawName, order: ElementOrder) -> Model:
    """Return a whole disc."""
    return disc_model(name, order=order, poisson=0.48, symmetry=MirrorSymmetry())


@pytest.mark.parametrize("name", [LawName.LINEAR, LawName.STABLE_NEO_HOOKEAN])
@pytest.mark.parametrize("order", list(ElementOrder))
def test_gradient_and_hessian_are_derivatives_of_the_energy(
    name: LawName, order: ElementOrder
) -> None:
    """Central differences along a random motion agree at a random deformed state."""
    model = coarse_model(name, order)
    rng = np.random.default_rng(5)
    positions = model.nodes + rng.normal(scale=2e-5, size=model.nodes.shape)
    motion = model.pattern.nodal(rng.normal(scale=1e-8, size=model.pattern.dof_count))
    ahead, behind = positions + motion, positions - motion
    rise = (model.gel.energy(ahead)[0] - model.gel.energy(behind)[0]) / 2.0
    change = (model.gel.gradient(ahead) - model.gel.gradient(behind)) / 2.0
    assert rise == pytest.approx(np.sum(model.gel.gradient(positions) * motion), rel=1e-6)
    product = matrix(model, positions, projected=False) @ model.pattern.unknowns(motion)
    expected = model.pattern.unknowns(change)
    assert np.abs(product - expected).max() < 1e-5 * np.abs(expected).max()


def test_projected_hessian_is_positive_definite_under_compression() -> None:
    """Half the height: the projected matrix has no negative eigenvalue."""
    model = coarse_model(LawName.STABLE_NEO_HOOKEAN, ElementOrder.P1)
    squeezed = model.nodes * np.array([1.0, 1.0, 0.5])
    eigenvalues = np.linalg.eigvalsh(matrix(model, squeezed, projected=True))
    assert eigenvalues.min() > 0.0


@pytest.mark.parametrize("order", list(ElementOrder))
@pytest.mark.parametrize("name", list(LawName))
def test_patch_of_uniform_strain_is_in_balance(name: LawName, order: ElementOrder) -> None:
    """A linear displacement leaves every inner node unloaded."""
    model = coarse_model(name, order)
    F = np.eye(3) + np.array([[0.02, 0.01, 0.0], [-0.01, 0.03, 0.02], [0.0, 0.01, -0.04]])
    gradient = model.gel.gradient(model.nodes @ F.T)
    inner = np.setdiff1d(np.flatnonzero(~model.clamped), model.faces)
    assert len(inner) > 10
    scale = model.young_pa * PAD.height_m**2
    assert np.abs(gradient[inner]).max() < 1e-10 * scale


PAPER_PA = 0.43e6


def paper_model(name: LawName, poisson: float) -> Model:
    """Return a disc of the paper's modulus."""
    return disc_model(name, young_pa=PAPER_PA, poisson=poisson, size_m=0.4e-3)


def test_undeformed_gel_is_under_the_shear_modulus() -> None:
    """Cauchy stress at rest is mu in every direction: 145 kPa for the gel of E 0.43 MPa."""
    model = paper_model(LawName.PAPER_EQ4, 0.48)
    stress = model.gel.cauchy_stress(model.nodes)
    expected = model.law.rest_stress(PAPER_PA, 0.48)
    assert expected == pytest.approx(145.3e3, rel=1e-3)
    assert np.allclose(stress, expected * np.eye(3), rtol=1e-9, atol=1e-3)


def test_stress_is_the_printed_formula() -> None:
    """Sigma = mu/J b + lambda (J - 1) 1 (paper, Eq. 4)."""
    model = paper_model(LawName.PAPER_EQ4, 0.45)
    F = np.array([[1.1, 0.05, 0.0], [0.0, 0.9, 0.1], [0.02, 0.0, 1.05]])
    mu = PAPER_PA / 2.0 / 1.45
    lam = PAPER_PA * 0.45 / 1.45 / 0.1
    J = np.linalg.det(F)
    expected = mu / J * F @ F.T + lam * (J - 1.0) * np.eye(3)
    assert np.allclose(model.gel.cauchy_stress(model.nodes @ F.T), expected, rtol=1e-9)


@pytest.mark.parametrize(("poisson", "shrink"), [(0.45, 0.0402), (0.48, 0.0143)])
def test_free_gel_has_no_stress_only_when_it_has_shrunk(poisson: float, shrink: float) -> None:
    """A gel that nothing holds is smaller by some per cent along every axis."""
    model = paper_model(LawName.PAPER_EQ4, poisson)
    stretch = free_stretch(poisson)
    assert 1.0 - stretch == pytest.approx(shrink, abs=1e-4)
    stress = model.gel.cauchy_stress(stretch * model.nodes)
    assert np.abs(stress).max() < 1e-7 * PAPER_PA


def test_free_gel_of_low_poisson_ratio_collapses() -> None:
    """Below nu = 0.339 no stretch is free of stress."""
    assert free_stretch(0.338) == 0.0
    assert free_stretch(0.0) == 0.0
    assert 0.6 < free_stretch(0.34) < 0.7


def test_clamped_pad_does_not_rest_in_its_own_shape() -> None:
    """Solved without an indenter, its top sinks by 7 % of the height; a usable law's stays."""
    top = np.array([0.0, 0.0, PAD.height_m])
    sink = {}
    for name in (LawName.PAPER_EQ4, LawName.STABLE_NEO_HOOKEAN):
        model = paper_model(name, 0.45)
        positions = unloaded_positions(model, options=SolverOptions())
        middle = int(np.argmin(np.linalg.norm(model.nodes - top, axis=1)))
        sink[name] = PAD.height_m - positions[middle, 2]
        if name is LawName.PAPER_EQ4:
            assert np.abs(model.pattern.unknowns(model.gel.gradient(positions))).max() < 1e-9
    assert sink[LawName.STABLE_NEO_HOOKEAN] == pytest.approx(0.0, abs=1e-15 * PAD.height_m)
    assert sink[LawName.PAPER_EQ4] == pytest.approx(0.07 * PAD.height_m, rel=0.1)


def test_depth_counts_from_the_shrunk_pad() -> None:
    """The path touches the pad where it stands, and its force begins there."""
    path = LoadingPath(paper_model(LawName.PAPER_EQ4, 0.45), Sphere(diameter_m=4e-3))
    assert path.touch_m == pytest.approx(0.93 * PAD.height_m, rel=0.01)
    assert path.advance(-2e-5).force_n[2] == 0.0
    assert path.advance(2e-5).force_n[2] > 0.0
