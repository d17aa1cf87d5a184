"""Elements, and a pad as they see it: what is held, what may be touched, how much there is."""

from __future__ import annotations

import numpy as np
import pytest

from sim.mesh.discretisation import Discretisation, discretise
from sim.mesh.elements import (
    ElementOrder,
    boundary_faces,
    linear_facets,
    quadratic_nodes,
    reference_element,
)
from sim.mesh.revolved import Grading, revolved_mesh
from sim.mesh.symmetry import MirrorSymmetry, WholeSurface
from sim.mesh.tet_mesh import TetMesh, oriented
from sim.scene.pad import BoxPad
from tacauchy_rig.core.errors import ConfigError

X, Y, Z = 8e-3, 6e-3, 2e-3
PAD = BoxPad(size_x_m=X, size_y_m=Y, height_m=Z)


def quarter(order: ElementOrder) -> tuple[TetMesh, Discretisation]:
    """Return a quarter of a box."""
    grading = Grading(start_m=1e-3, end_m=1e-3, size_m=0.6e-3)
    mesh = revolved_mesh(PAD, grading, centre_m=(0.0, 0.0), sector_count=8, name="box")
    return mesh, discretise(mesh, order=order)


@pytest.mark.parametrize("order", list(ElementOrder))
def test_a_quarter_has_a_quarters_gel(order: ElementOrder) -> None:
    """Volume, and the touchable faces: top and outer sides, neither base nor mirror planes."""
    _, part = quarter(order)
    assert part.volumes.sum() == pytest.approx(X * Y * Z / 4, rel=1e-9)
    assert part.face_areas.sum() == pytest.approx(X * Y / 4 + (X + Y) / 2 * Z, rel=1e-9)
    assert np.all(part.nodes[part.clamped, 2] == 0.0)
    highest = part.nodes[part.elements[part.touched_element], 2].max()
    assert highest == pytest.approx(Z)


@pytest.mark.parametrize("order", list(ElementOrder))
def test_only_what_is_free_is_unknown(order: ElementOrder) -> None:
    """Clamped nodes have no unknowns, nodes on a mirror plane none across it."""
    mesh, part = quarter(order)
    held = mesh.symmetry.on_plane(part.nodes, X)
    assert part.pattern.dof_count == int((~(held | part.clamped[:, None])).sum())
    unknowns = np.arange(1.0, part.pattern.dof_count + 1.0)
    nodal = part.pattern.nodal(unknowns)
    assert not nodal[part.clamped].any()
    np.testing.assert_array_equal(part.pattern.unknowns(nodal), unknowns)


def test_a_part_stands_for_the_whole() -> None:
    """The mirrored faces close to the whole's area, and nodal forces add up to the whole's."""
    mesh, part = quarter(ElementOrder.P1)
    whole = WholeSurface(mesh.symmetry, part.nodes)
    rest, faces = whole.at_nodes(part.nodes), whole.faces(part.faces)
    a, b, c = (rest[faces[:, k]] for k in range(3))
    vectors = 0.5 * np.cross(b - a, c - a)
    # The sides' area vectors cancel, the top's remains.
    np.testing.assert_allclose(vectors.sum(axis=0), [0.0, 0.0, X * Y], atol=1e-12)
    forces = np.random.default_rng(0).normal(size=part.nodes.shape)
    forces[mesh.symmetry.on_plane(part.nodes, X)] = 0.0
    total = mesh.symmetry.whole_force(forces.sum(axis=0))
    np.testing.assert_allclose(whole.nodal_forces(forces).sum(axis=0), total, atol=1e-9)


def test_flat_tetrahedra_are_refused() -> None:
    """One without volume is counted."""
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    with pytest.raises(ConfigError, match="1 tetrahedra of no positive volume"):
        discretise(
            oriented(TetMesh(vertices=vertices, tets=np.array([[0, 1, 2, 3]]), name="flat")),
            order=ElementOrder.P1,
        )


@pytest.mark.parametrize("order", list(ElementOrder))
def test_shape_functions_sum_to_one(order: ElementOrder) -> None:
    """Values sum to one, gradients to zero, weights to one."""
    element = reference_element(order)
    assert element.weights.sum() == pytest.approx(1.0)
    assert element.face_weights.sum() == pytest.approx(1.0)
    assert np.allclose(element.gradients.sum(axis=1), 0.0, atol=1e-14)
    assert np.allclose(element.face_values.sum(axis=1), 1.0)
    assert np.allclose(element.face_gradients.sum(axis=1), 0.0, atol=1e-14)


def test_quadratic_gradients_reproduce_a_quadratic() -> None:
    """The gradient of x^2 + y z is exact at the quadrature points."""
    element = reference_element(ElementOrder.P2)
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    nodes, tets = quadratic_nodes(corners, np.array([[0, 1, 2, 3]], dtype=np.int32))
    values = nodes[tets[0], 0] ** 2 + nodes[tets[0], 1] * nodes[tets[0], 2]
    near, far = 0.5854101966249685, 0.1381966011250105
    points = np.array([[far] * 3, [near, far, far], [far, near, far], [far, far, near]])
    expected = np.column_stack([2 * points[:, 0], points[:, 2], points[:, 1]])
    assert np.allclose(np.einsum("qni,n->qi", element.gradients, values), expected)


def test_contact_rule_is_exact_to_degree_six() -> None:
    """The mean of a^2 b^2 c^2 over a triangle is 2! 2! 2! 2! / 8!."""
    element = reference_element(ElementOrder.P1)
    product = (element.face_values**2).prod(axis=1)
    assert product @ element.face_weights == pytest.approx(16.0 / 40320.0, rel=1e-10)


def test_boundary_is_closed_and_looks_outwards() -> None:
    """Area vectors sum to zero, and x . n integrates to three times the volume."""
    grading = Grading(start_m=1e-3, end_m=1e-3, size_m=0.5e-3)
    whole = {"centre_m": (0.5e-3, 0.0), "symmetry": MirrorSymmetry()}
    mesh = revolved_mesh(PAD, grading, sector_count=12, name="box", **whole)
    for elements, nodes in (
        (mesh.tets, mesh.vertices),
        quadratic_nodes(mesh.vertices, mesh.tets)[::-1],
    ):
        faces, parents = boundary_faces(elements)
        a, b, c = (nodes[linear_facets(faces)[:, k]] for k in range(3))
        vectors = 0.5 * np.cross(b - a, c - a)
        assert np.allclose(vectors.sum(axis=0), 0.0, atol=1e-16)
        volume = np.sum(vectors * (a + b + c) / 3.0) / 3.0
        assert volume == pytest.approx(X * Y * Z, rel=1e-9)
        assert all(set(face) <= set(elements[p]) for face, p in zip(faces, parents, strict=True))
