"""The laws: energy, gradient and Hessian belong together, and rest is stress-free."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse

from sim.material.laws.tangent import law
from sim.mesh.elements import ElementOrder
from sim.mesh.revolved import Grading, revolved_mesh
from sim.mesh.symmetry import MirrorSymmetry
from sim.scene.material import LawName
from sim.scene.pad import DiscPad
from sim.solve.model import Model
from tacauchy_rig.core.arrays import FloatArray

PAD = DiscPad(radius_m=3e-3, height_m=2e-3)
GRADING = Grading(start_m=1e-3, end_m=1e-3, size_m=0.6e-3, growth=2.0)


def coarse_model(name: LawName, order: ElementOrder) -> Model:
    """Return a pad of some hundred elements."""
    mesh = revolved_mesh(
        PAD, GRADING, centre_m=(0.0, 0.0), sector_count=8, name="test", symmetry=MirrorSymmetry()
    )
    return Model(mesh, order=order, law=law(name), young_pa=4e5, poisson=0.48)


def matrix(model: Model, positions: FloatArray, *, projected: bool) -> scipy.sparse.csr_matrix:
    """Return the assembled elastic Hessian of the unknowns, both triangles."""
    stiffness = np.zeros((*model.surface.areas.shape, 3, 3))
    data = model.hessian_data(positions, stiffness, projected=projected)
    shape = (model.pattern.dof_count, model.pattern.dof_count)
    upper = scipy.sparse.csr_matrix((data, model.pattern.indices, model.pattern.indptr), shape)
    return upper + scipy.sparse.triu(upper, 1).T


@pytest.mark.parametrize("name", list(LawName))
@pytest.mark.parametrize("order", list(ElementOrder))
def test_gradient_and_hessian_are_derivatives_of_the_energy(
    name: LawName, order: ElementOrder
) -> None:
    """Central differences along a random motion agree at a random deformed state."""
    model = coarse_model(name, order)
    rng = np.random.default_rng(5)
    positions = model.nodes + rng.normal(scale=2e-5, size=model.nodes.shape)
    motion = model.pattern.nodal(rng.normal(scale=1e-8, size=model.pattern.dof_count))
    rise = (model.gel.energy(positions + motion)[0] - model.gel.energy(positions - motion)[0]) / 2.0
    change = (model.gel.gradient(positions + motion) - model.gel.gradient(positions - motion)) / 2.0
    assert rise == pytest.approx(np.sum(model.gel.gradient(positions) * motion), rel=1e-6)
    product = matrix(model, positions, projected=False) @ model.pattern.unknowns(motion)
    expected = model.pattern.unknowns(change)
    assert np.abs(product - expected).max() < 1e-5 * np.abs(expected).max()


@pytest.mark.parametrize("name", [name for name in LawName if name is not LawName.PAPER_EQ4])
def test_rest_has_no_stress(name: LawName) -> None:
    """No force and no energy at rest."""
    model = coarse_model(name, ElementOrder.P2)
    scale = model.young_pa * PAD.height_m**2
    assert np.abs(model.gel.gradient(model.nodes)).max() < 1e-12 * scale
    assert abs(model.gel.energy(model.nodes)[0]) < 1e-12 * scale * PAD.height_m


def test_stable_law_matches_the_stress_formula() -> None:
    """Cauchy stress of a uniform stretch equals P F^T / J of the written law."""
    model = coarse_model(LawName.STABLE_NEO_HOOKEAN, ElementOrder.P2)
    F = np.array([[1.1, 0.05, 0.0], [0.0, 0.9, 0.1], [0.02, 0.0, 1.05]])
    young, poisson = model.young_pa, model.poisson
    mu, lam = young / 2 / (1 + poisson), young * poisson / (1 + poisson) / (1 - 2 * poisson)
    m, volume = 4 / 3 * mu, lam + 5 / 6 * mu
    J, trace = np.linalg.det(F), np.sum(F * F)
    cofactor = J * np.linalg.inv(F).T
    P = m * (1 - 1 / (trace + 1)) * F + volume * (J - 1 - 0.75 * m / volume) * cofactor
    stress = model.gel.cauchy_stress(model.nodes @ F.T)
    assert np.allclose(stress, P @ F.T / J, rtol=1e-9)


def test_projected_hessian_is_positive_definite_under_compression() -> None:
    """Half the height: the projected matrix has no negative eigenvalue."""
    model = coarse_model(LawName.STABLE_NEO_HOOKEAN, ElementOrder.P1)
    squeezed = model.nodes * np.array([1.0, 1.0, 0.5])
    eigenvalues = np.linalg.eigvalsh(matrix(model, squeezed, projected=True).toarray())
    assert eigenvalues.min() > 0.0


@pytest.mark.parametrize("order", list(ElementOrder))
@pytest.mark.parametrize("name", [name for name in LawName if name is not LawName.LINEAR])
def test_rigid_motion_makes_no_force(name: LawName, order: ElementOrder) -> None:
    """A large rotation and a shift load no node more than rest does."""
    model = coarse_model(name, order)
    angle = 0.7
    turn = np.array(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    )
    moved = model.nodes @ turn.T + np.array([1e-3, -2e-3, 5e-4])
    scale = model.young_pa * PAD.height_m**2
    forces = model.gel.gradient(moved) - model.gel.gradient(model.nodes) @ turn.T
    assert np.abs(forces).max() < 1e-10 * scale


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
