"""Stress on the surface and where layers meet, recovered tractions, and the files of a press."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import pyvista
import scipy.sparse.linalg

from sim.effects.presets import build_model, mesh_for
from sim.fields.pressure_and_shear import SurfaceTraction, surface_traction
from sim.fields.saved_press import gel_vtu, indenter_vtu, surface_state, trial_fields
from sim.fields.stress import InterfaceTraction, StressOnSides, cauchy_stress, interface_traction
from sim.material.elastic_body import element_constants
from sim.material.laws.law_and_lame import law
from sim.mesh.clamping_and_sparsity import assembled
from sim.mesh.elements import ElementOrder
from sim.mesh.revolved_mesh import Grading, revolved_mesh
from sim.scene.indenter import Sphere
from sim.scene.material import LawName, Material
from sim.scene.pad import DiscPad
from sim.scene.scene import Scene
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model
from sim.solve.path_point import PathPoint
from sim.studies.verification.balance import forces_n, smooth_sides
from tacauchy_rig.core.arrays import BoolArray, FloatArray


def test_even_strain_gives_even_stress_without_an_error(
    pressed: tuple[LoadingPath, PathPoint],
) -> None:
    """Nodes on corners and on edges, and cells, have the one stress there is."""
    model, stretch = pressed[0].model, np.diag([1.05, 0.98, 0.97])
    found = cauchy_stress(model, model.nodes @ stretch)
    expected = found.cells_pa[0]
    size = np.abs(expected).max()
    np.testing.assert_allclose(found.nodes_pa - expected, 0.0, atol=1e-6 * size)
    np.testing.assert_allclose(found.cells_pa - expected, 0.0, atol=1e-6 * size)
    assert found.errors_pa.max() < 1e-6 * size


def test_the_estimated_error_falls_with_the_edges(ball: Scene) -> None:
    """As the square of the edges, or nearly: twice shorter, at most 0.45 times the error."""

    def error(refinement: float) -> float:
        path = LoadingPath(build_model(ball, refinement=refinement), ball.indenter)
        point = path.advance(0.2e-3)
        found, volumes = cauchy_stress(path.model, point.state.positions), path.model.discretisation
        return float(np.sqrt(found.errors_pa**2 @ volumes.volumes))

    assert error(2.0) < 0.45 * error(1.0)


def test_the_whole_gel_is_written_with_its_stress(
    pressed: tuple[LoadingPath, PathPoint], tmp_path: Path
) -> None:
    """Four copies of the quarter, none inside out; tensors are mirrored as they must be."""
    path, point = pressed
    file = tmp_path / "gel.vtu"
    file.write_bytes(gel_vtu(path.model, point))
    grid = pyvista.read(file)
    assert grid.n_cells == 4 * len(path.model.elements)
    volumes = grid.linear_copy().compute_cell_sizes()["Volume"]
    assert volumes.min() > 0.0
    assert volumes.sum() == pytest.approx(4.0 * path.model.volume_m3, rel=0.01)
    stress, places = grid.point_data["cauchy_stress_pa"], grid.points
    assert stress.shape == (grid.n_points, 6)
    assert grid.cell_data["cauchy_stress_pa"].shape == (grid.n_cells, 6)
    assert grid.cell_data["cauchy_stress_error_pa"].min() >= 0.0
    image = [grid.find_closest_point(place) for place in places[:200] * (-1.0, 1.0, 1.0)]
    np.testing.assert_allclose(
        stress[:200] * (1.0, 1.0, 1.0, -1.0, 1.0, -1.0), stress[image], atol=1e-6
    )


def test_the_indenter_stands_where_it_presses(
    pressed: tuple[LoadingPath, PathPoint], tmp_path: Path
) -> None:
    """Its lowest point is the tip, moved by the wide barrier's reach, its width the ball's."""
    surface = surface_state(*pressed)
    file = tmp_path / "indenter.vtu"
    file.write_bytes(indenter_vtu(surface))
    grid = pyvista.read(file)
    assert grid.bounds[4] == pytest.approx(surface.indenter_position[2], abs=1e-12)
    assert grid.bounds[1] - grid.bounds[0] == pytest.approx(8e-3, rel=0.02)


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


def recovered_tractions(
    model: Model, positions: FloatArray, interface: InterfaceTraction
) -> tuple[FloatArray, FloatArray]:
    """Return the tractions whose virtual work is that of the nodal forces below, and above.

    Each balances the press, and equilibrium of the nodes makes both equal, but for weight. On a
    mirror plane their components across the plane are zero.

    Returns:
        On the upper side of the lower layer, at the interface's nodes in rising order [Pa], shape
        [n, 3] each.
    """
    values, nodes = model.reference.face_values, np.unique(interface.faces)
    blocks = np.einsum("fp,pi,pj->fij", interface.element.areas_m2, values, values)
    mass = assembled(blocks, np.searchsorted(nodes, interface.faces), len(nodes)).tocsc()
    size = float(np.abs(model.mesh.vertices).max())
    held = model.mesh.symmetry.on_plane(model.nodes[nodes], size)

    def traction(forces: FloatArray) -> FloatArray:
        found = np.zeros_like(forces)
        for axis in range(3):
            free = np.flatnonzero(~held[:, axis])
            part = mass[free][:, free]
            found[free, axis] = scipy.sparse.linalg.spsolve(part, forces[free, axis])
        return found

    below = nodal_forces(model, positions, interface.below)[nodes]
    above = nodal_forces(model, positions, ~interface.below)[nodes]
    return traction(below), traction(-above)


def nodal_forces(model: Model, positions: FloatArray, chosen: BoolArray) -> FloatArray:
    """Return the sum of some elements' nodal forces [N], shape [node_count, 3].

    An element's force on node n is the sum over its points of w sigma cof(dx/dxi) grad N_n.
    """
    nodes = model.elements[chosen]
    deformed = np.einsum("enx,qny->eqxy", positions[nodes], model.reference.gradients)
    inverse = np.swapaxes(np.linalg.inv(deformed), 2, 3)
    cofactors = np.linalg.det(deformed)[..., None, None] * inverse
    shares = model.reference.weights[:, None, None]
    weighted = model.gel.cauchy_stress(positions)[chosen] * shares / 6.0
    forces = np.einsum("eqik,qnk->eni", weighted @ cofactors, model.reference.gradients)
    total = np.zeros_like(positions)
    np.add.at(total, nodes, forces)
    return total


def layered_press(model: Model) -> tuple[InterfaceTraction, StressOnSides, float, float, float]:
    """Return interface, smooth sides, the recovered tractions' gap, indenter's and base's force."""
    point = LoadingPath(model, Sphere(diameter_m=16e-3)).advance(0.15e-3)
    (interface,) = interface_traction(model, point.state.positions)
    clamped = point.equilibrium.elastic_gradient[model.clamped].sum(axis=0)
    lower, upper = recovered_tractions(model, point.state.positions, interface)
    assert len(lower) == len(upper) == int(np.isclose(model.nodes[:, 2], 2e-3).sum())
    apart = float(np.linalg.norm(upper - lower) / np.linalg.norm(lower))
    sides = smooth_sides(model, point.state.positions, interface)
    base = -model.mesh.symmetry.whole_force(clamped)[2]
    return interface, sides, apart, point.force_n[2], base


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
    found = smooth_sides(model, positions, interface)
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
    interface, _, apart, force, base = layered_press(model)
    assert interface.force_n[2] == pytest.approx(force, rel=1e-6)
    assert interface.force_n[2] == pytest.approx(-base, rel=1e-6)
    assert np.hypot(*interface.force_n[:2]) < 1e-9 * force
    assert apart < 1e-6


def test_jump_shrinks_with_refinement() -> None:
    """Half the edge: the jump and the integrals' gaps to the force shrink."""
    first, second = layered_model(10.0), layered_model(10.0, size_m=0.5e-3, sectors=24)
    coarse, coarse_sides, _, force, _ = layered_press(first)
    fine, fine_sides, _, fine_force, _ = layered_press(second)
    assert fine.element.jump_relative < 0.75 * coarse.element.jump_relative
    assert fine_sides.jump_relative < 0.6 * coarse_sides.jump_relative
    assert fine_sides.jump_relative < fine.element.jump_relative
    for integral in forces_n(second, fine_sides):
        assert integral[2] == pytest.approx(fine_force, rel=0.03)
    off, coarse_off = (
        abs(forces_n(model, found.element)[0][2] / pushed - 1.0)
        for model, found, pushed in ((second, fine, fine_force), (first, coarse, force))
    )
    assert off < coarse_off


def test_a_quadratic_pressure_is_recovered_exactly_inside_the_contact(
    pressed: tuple[LoadingPath, PathPoint],
) -> None:
    """Whatever the mesh: the fit is of the element's order."""
    path, point = pressed
    model = path.model
    contact = point.equilibrium.contact
    areas = np.linalg.norm(model.surface.area_vectors(point.state.positions), axis=2)

    def wanted(x: FloatArray) -> FloatArray:
        return np.asarray(1e4 + 3e9 * x[..., 0] ** 2 + 1e9 * x[..., 1] ** 2)

    touched = np.any(contact.forces != 0.0, axis=2)
    away = np.hypot(contact.points[..., 0], contact.points[..., 1])
    flat = np.zeros_like(contact.forces)
    flat[..., 2] = np.where(touched, areas * wanted(contact.points), 0.0)
    stated = replace(contact, forces=flat)
    equilibrium = replace(point.equilibrium, contact=stated)
    found = surface_traction(model, replace(point, equilibrium=equilibrium))
    places = point.state.positions
    inner = np.hypot(places[:, 0], places[:, 1]) < 0.4 * away[touched].max()
    chosen = np.intersect1d(np.flatnonzero(inner), np.unique(model.faces))
    # The gel is curved: in a node's tangent plane the pressure is quadratic but for its slope's.
    np.testing.assert_allclose(found.pressure_pa[chosen], wanted(places[chosen]), rtol=2e-3)
    assert len(chosen) > 10


def test_a_quarter_gives_what_the_whole_gives(
    ball: Scene, pressed: tuple[LoadingPath, PathPoint]
) -> None:
    """On the mirror planes too, where half of a node's patch is an image."""
    part, point = pressed
    whole = LoadingPath(build_model(ball, mesh=mesh_for(ball, symmetric=False)), ball.indenter)

    def by_place(model: Model, found: SurfaceTraction) -> dict[tuple[float, ...], float]:
        nodes = np.unique(model.faces)
        rest = np.round(model.nodes[nodes] * 1e9) + 0.0
        return dict(zip(map(tuple, rest), found.pressure_pa[nodes], strict=True))

    quarter = by_place(part.model, surface_traction(part.model, point))
    full = by_place(whole.model, surface_traction(whole.model, whole.advance(0.2e-3)))
    largest = max(full.values())
    for place, pressure in quarter.items():
        assert pressure == pytest.approx(full[place], abs=2e-4 * largest)


def test_nodal_forces_are_split_along_the_surface(pressed: tuple[LoadingPath, PathPoint]) -> None:
    """Both parts add up, and without friction next to nothing lies along the surface."""
    _, point = pressed
    found = trial_fields(*pressed).at_nodes
    force, normal, tangential = (
        found[f"contact_{part}force_n"] for part in ("", "normal_", "tangential_")
    )
    np.testing.assert_allclose(normal + tangential, force, atol=1e-15)
    assert np.abs(tangential).sum() < 0.05 * np.abs(normal).sum()
    assert np.abs(found["contact_shear_pa"]).max() < 1e-9 * found["contact_pressure_pa"].max()
    np.testing.assert_allclose(force.sum(axis=0), -point.force_n, atol=1e-9)
