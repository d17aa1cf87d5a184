"""Masses, weight and inertia at the nodes."""

from __future__ import annotations

import numpy as np
import pytest

from sim.contact.state import ContactOptions
from sim.material.laws.tangent import law
from sim.mesh.elements import ElementOrder
from sim.mesh.revolved import Grading, revolved_mesh
from sim.mesh.symmetry import MirrorSymmetry
from sim.scene.material import LawName
from sim.scene.pad import DiscPad
from sim.solve.equilibrium import SolverOptions
from sim.solve.loading_path import unloaded_positions
from sim.solve.model import Model
from sim.solve.nodal_energies import (
    INERTIA,
    STANDARD_M_S2,
    WEIGHT,
    Inertia,
    Shares,
    nodal_masses,
    weight,
)

PAD = DiscPad(radius_m=3e-3, height_m=2e-3)
DENSITY = 1070.0
YOUNG_PA = 4e5


def disc(
    order: ElementOrder, *, symmetric: bool = False, law_name: LawName = LawName.LINEAR
) -> Model:
    """Return a clamped disc of some hundred elements."""
    grading = Grading(start_m=1e-3, end_m=1e-3, size_m=0.4e-3, growth=2.0)
    mesh = revolved_mesh(
        PAD,
        grading,
        centre_m=(0.0, 0.0),
        sector_count=8,
        name="test",
        symmetry=None if symmetric else MirrorSymmetry(),
    )
    return Model(mesh, order=order, law=law(law_name), young_pa=YOUNG_PA, poisson=0.3)


@pytest.mark.parametrize("shares", [WEIGHT, INERTIA])
@pytest.mark.parametrize("order", list(ElementOrder))
def test_masses_sum_to_the_pad(shares: Shares, order: ElementOrder) -> None:
    """Nothing is lost, and one density an element gives what one density for all gives."""
    model = disc(order)
    found = nodal_masses(model, DENSITY, shares)
    assert found.sum() == pytest.approx(DENSITY * model.volume_m3, rel=1e-12)
    each = nodal_masses(model, np.full(len(model.elements), DENSITY), shares)
    assert np.allclose(found, each, rtol=1e-14)


def test_inertial_masses_are_positive() -> None:
    """Quadratic corners weigh less than nothing, but every node resists acceleration."""
    model = disc(ElementOrder.P2)
    assert nodal_masses(model, DENSITY, WEIGHT).min() < 0.0
    assert nodal_masses(model, DENSITY, INERTIA).min() > 0.0


@pytest.mark.parametrize("order", list(ElementOrder))
def test_weight_does_the_work_of_a_linear_motion(order: ElementOrder) -> None:
    """Energy of a stretch equals minus m g times the centre's motion: the sharing is consistent."""
    model = disc(order)
    found = weight(model, DENSITY)
    F = np.array([[1.1, 0.05, 0.0], [0.0, 0.9, 0.1], [0.02, 0.0, 1.05]])
    moved = model.nodes @ F.T + np.array([1e-4, 2e-4, -3e-4])
    shares = nodal_masses(model, 1.0, WEIGHT) / model.volume_m3
    centre = shares @ (moved - model.nodes)
    work = -DENSITY * model.volume_m3 * STANDARD_M_S2 * float(centre[2])
    assert found.energy(moved) == pytest.approx(-work, rel=1e-12)
    assert centre[2] == pytest.approx(0.05 * PAD.height_m / 2.0 - 3e-4, rel=1e-9)


def test_weight_sags_the_pad_as_a_column_does() -> None:
    """A wide clamped layer sinks by rho g H^2 / (2 M), M the modulus without sideways strain."""
    model = disc(ElementOrder.P2, symmetric=True)
    positions = unloaded_positions(
        model, options=SolverOptions(residual_floor_n=1e-13), potentials=[weight(model, DENSITY)]
    )
    middle = int(np.argmin(np.linalg.norm(model.nodes - [0.0, 0.0, PAD.height_m], axis=1)))
    modulus = YOUNG_PA * (1 - 0.3) / ((1 + 0.3) * (1 - 2 * 0.3))
    expected = DENSITY * STANDARD_M_S2 * PAD.height_m**2 / (2.0 * modulus)
    assert PAD.height_m - positions[middle, 2] == pytest.approx(expected, rel=0.15)
    assert expected / PAD.height_m == pytest.approx(2e-5, rel=0.1)


def test_a_soft_skin_on_a_stiff_base_settles_under_its_weight() -> None:
    """What rounding leaves is the stiff base's; beside the skin's modulus it never settled."""
    plain = disc(ElementOrder.P2)
    in_skin = plain.nodes[plain.elements[:, :4], 2].mean(axis=1) > 0.8 * PAD.height_m
    model = Model(
        plain.mesh,
        order=ElementOrder.P2,
        law=law(LawName.STABLE_NEO_HOOKEAN),
        young_pa=np.where(in_skin, 1e-3, 1.0) * YOUNG_PA,
        poisson=0.49,
        contact_options=ContactOptions(distance_m=40e-6, friction=0.8),
    )
    positions = unloaded_positions(
        model, options=SolverOptions(), potentials=[weight(model, DENSITY)]
    )
    assert 0.0 < PAD.height_m - positions[:, 2].max() < 0.01 * PAD.height_m


@pytest.mark.parametrize("kind", ["weight", "inertia"])
def test_gradient_and_diagonal_are_derivatives(kind: str) -> None:
    """Central differences of the energy and of the gradient agree."""
    model = disc(ElementOrder.P2)
    rng = np.random.default_rng(2)
    moved = model.nodes + rng.normal(scale=1e-4, size=model.nodes.shape)
    motion = rng.normal(scale=1e-5, size=model.nodes.shape)
    memory = Inertia(model, DENSITY)
    memory.forget(model.nodes + 1e-5)
    memory.begin_step(1e-4)
    potential = memory.flight[0] if kind == "inertia" else weight(model, DENSITY)
    rise = (potential.energy(moved + motion) - potential.energy(moved - motion)) / 2.0
    assert rise == pytest.approx(float(np.sum(potential.gradient(moved) * motion)), rel=1e-9)
    change = (potential.gradient(moved + motion) - potential.gradient(moved - motion)) / 2.0
    assert np.allclose(change, potential.diagonal() * motion, rtol=1e-9, atol=1e-18)
