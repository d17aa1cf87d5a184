"""Traction where layers meet."""

from __future__ import annotations

import numpy as np
import pytest

from sim.fields.interface import InterfaceTraction, interface_traction
from sim.material.elastic_body import element_constants
from sim.material.laws.tangent import law
from sim.mesh.elements import ElementOrder
from sim.mesh.revolved import Grading, revolved_mesh
from sim.scene.indenter import Sphere
from sim.scene.material import LawName, Material
from sim.scene.pad import DiscPad
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model
from sim.studies.verification.balance import InterfaceSides, forces_n, interface_sides

PAD = DiscPad(radius_m=6e-3, height_m=4e-3)


def layered_model(
    ratio: float, *, size_m: float = 1e-3, sectors: int = 12, order: ElementOrder = ElementOrder.P2
) -> Model:
    """Return a disc whose upper half is ``ratio`` times as stiff as its lower."""
    base = Material(young_pa=1e5, poisson=0.3)
    top = Material(young_pa=1e5 * ratio, poisson=0.3)
    grading = Grading(start_m=0.0, end_m=1.5e-3, size_m=size_m, growth=1.3, size_max_m=2.0 * size_m)
    mesh = revolved_mesh(
        PAD,
        grading,
        centre_m=(0.0, 0.0),
        sector_count=sectors,
        name="test",
        interface_shares=(0.5,),
    )
    young, poisson = element_constants(mesh, [base, top])
    return Model(mesh, order=order, law=law(LawName.LINEAR), young_pa=young, poisson=poisson)


def pressed(model: Model) -> tuple[InterfaceTraction, InterfaceSides, float, float]:
    """Press a sphere in; return the interface, its sides, the indenter's and the base's force."""
    point = LoadingPath(model, Sphere(diameter_m=16e-3)).advance(0.15e-3)
    (interface,) = interface_traction(model, point.state.positions)
    clamped = point.equilibrium.elastic_gradient[model.clamped].sum(axis=0)
    sides = interface_sides(model, point.state.positions, interface)
    return interface, sides, point.force_n[2], -model.mesh.symmetry.whole_force(clamped)[2]


@pytest.mark.parametrize("order", list(ElementOrder))
def test_piecewise_linear_motion_has_the_exact_traction(order: ElementOrder) -> None:
    """Uniform strain in each half, M e the same: no jump, and t_z = M e on both sides."""
    model = layered_model(5.0, order=order)
    positions = model.nodes.copy()
    strain, middle = -1e-3, 0.5 * PAD.height_m
    z = model.nodes[:, 2]
    positions[:, 2] += strain * np.minimum(z, middle)
    positions[:, 2] += strain / 5.0 * np.maximum(z - middle, 0.0)
    (interface,) = interface_traction(model, positions)
    found = interface_sides(model, positions, interface).smooth
    modulus = 1e5 * 0.7 / (1.3 * 0.4)
    expected = modulus * strain / (1.0 + strain)
    smooth = (found.below_pa, found.above_pa)
    for side in (interface.element.below_pa, interface.element.above_pa, *smooth):
        assert side[..., 2] == pytest.approx(expected, rel=5e-3)
    assert interface.element.jump_relative < 1e-2
    assert found.jump_relative < 1e-2
    assert found.areas_m2.sum() * model.mesh.symmetry.copies == pytest.approx(
        np.pi * PAD.radius_m**2, rel=0.1
    )


@pytest.mark.parametrize("ratio", [1.0, 10.0, 1e4])
def test_what_goes_through_is_what_is_pressed(ratio: float) -> None:
    """The interface's force is the indenter's and the base's to 1e-6; so is the recovered one's."""
    model = layered_model(ratio)
    interface, sides, force, base = pressed(model)
    assert interface.force_n[2] == pytest.approx(force, rel=1e-6)
    assert interface.force_n[2] == pytest.approx(-base, rel=1e-6)
    assert np.hypot(*interface.force_n[:2]) < 1e-9 * force
    assert len(sides.recovered_pa) == len(sides.nodes)
    assert np.allclose(model.nodes[sides.nodes, 2], 2e-3)
    assert sides.recovered_jump_relative < 1e-6


def test_jump_shrinks_with_refinement() -> None:
    """Half the edge: the jump and the integrals' gaps to the force shrink."""
    first, second = layered_model(10.0), layered_model(10.0, size_m=0.5e-3, sectors=24)
    coarse, coarse_sides, force, _ = pressed(first)
    fine, fine_sides, fine_force, _ = pressed(second)
    assert fine.element.jump_relative < 0.75 * coarse.element.jump_relative
    assert fine_sides.smooth.jump_relative < 0.6 * coarse_sides.smooth.jump_relative
    assert fine_sides.smooth.jump_relative < fine.element.jump_relative
    for integral in forces_n(second, fine_sides.smooth):
        assert integral[2] == pytest.approx(fine_force, rel=0.03)
    off, coarse_off = (
        abs(forces_n(model, found.element)[0][2] / pushed - 1.0)
        for model, found, pushed in ((second, fine, fine_force), (first, coarse, force))
    )
    assert off < coarse_off
