"""Shape functions, quadrature and faces of both element orders."""

from __future__ import annotations

import numpy as np
import pytest

from sim.mesh.elements import (
    ElementOrder,
    boundary_faces,
    linear_facets,
    quadratic_nodes,
    reference_element,
)
from sim.mesh.revolved import Grading, revolved_mesh
from sim.mesh.symmetry import MirrorSymmetry
from sim.mesh.tet_mesh import TetMesh
from sim.scene.pad import BoxPad

PAD = BoxPad(size_x_m=8e-3, size_y_m=6e-3, height_m=2e-3)


@pytest.fixture(scope="module")
def mesh() -> TetMesh:
    """Return a whole box."""
    grading = Grading(start_m=1e-3, end_m=1e-3, size_m=0.5e-3)
    return revolved_mesh(
        PAD, grading, centre_m=(0.5e-3, 0.0), sector_count=12, name="box", symmetry=MirrorSymmetry()
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


def test_boundary_is_closed_and_looks_outwards(mesh: TetMesh) -> None:
    """Area vectors sum to zero, and x . n integrates to three times the volume."""
    for elements, nodes in (
        (mesh.tets, mesh.vertices),
        quadratic_nodes(mesh.vertices, mesh.tets)[::-1],
    ):
        faces, parents = boundary_faces(elements)
        a, b, c = (nodes[linear_facets(faces)[:, k]] for k in range(3))
        vectors = 0.5 * np.cross(b - a, c - a)
        assert np.allclose(vectors.sum(axis=0), 0.0, atol=1e-16)
        volume = np.sum(vectors * (a + b + c) / 3.0) / 3.0
        assert volume == pytest.approx(8e-3 * 6e-3 * 2e-3, rel=1e-9)
        assert all(set(face) <= set(elements[p]) for face, p in zip(faces, parents, strict=True))
