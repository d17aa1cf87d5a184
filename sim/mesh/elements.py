"""Tetrahedra of order one and two: shape functions, quadrature, and their surface faces.

Both orders share every kernel: an element is a table of reference gradients at quadrature points.
Node order follows VTK: corners 0-3, then the edges 01, 12, 20, 03, 13, 23. Quadratic elements are
straight-sided at rest, so one inverse Jacobian serves all their points.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from tacauchy_rig.core.arrays import FloatArray, IntArray

EDGES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3))
# Of a quadratic tetrahedron: a face's corners, and the middles of its edges.
_QUADRATIC_FACES = ((0, 2, 1, 6, 5, 4), (0, 1, 3, 4, 8, 7), (1, 2, 3, 5, 9, 8), (2, 0, 3, 6, 7, 9))
FACE_EDGES = ((0, 1), (1, 2), (2, 0))
# Nodes of a quadratic face at the corners of its four parts.
QUARTERS = ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5))
# Of the linear shape functions.
_TRIANGLE_GRADIENTS = np.concatenate([[[-1.0, -1.0]], np.eye(2)])
_TET_GRADIENTS = np.concatenate([[[-1.0, -1.0, -1.0]], np.eye(3)])


class ElementOrder(StrEnum):
    """Polynomial order of the displacement."""

    P1 = "P1"
    P2 = "P2"


@dataclass(frozen=True, slots=True, kw_only=True)
class ReferenceElement:
    """Tables of one element type: its shape functions, on faces too, their gradients and points."""

    order: ElementOrder
    gradients: FloatArray  # in reference coordinates, shape [point_count, node_count, 3]
    points: FloatArray  # barycentric coordinates of the quadrature points, shape [point_count, 4]
    weights: FloatArray  # quadrature weights that sum to one, shape [point_count]
    face_values: FloatArray  # at contact points, shape [face_point_count, face_node_count]
    face_gradients: FloatArray  # along edges 01 and 02, [face_point_count, face_node_count, 2]
    face_weights: FloatArray  # contact quadrature weights that sum to one, shape [face_point_count]
    face_points: FloatArray  # contact points' barycentric coordinates, [face_point_count, 3]

    @property
    def node_count(self) -> int:
        """Nodes of an element."""
        return int(self.gradients.shape[1])

    @property
    def face_node_count(self) -> int:
        """Nodes of a face."""
        return int(self.face_values.shape[1])

    def area_vectors(self, face_nodes: FloatArray) -> FloatArray:
        """Return outward normal times area at the contact points [m^2], shape [face, point, 3].

        Args:
            face_nodes: Positions of the faces' nodes [m], shape [face_count, face_node_count, 3].
        """
        along = np.einsum("pka,fkx->afpx", self.face_gradients, face_nodes)
        return np.asarray(0.5 * np.cross(along[0], along[1]) * self.face_weights[:, None])


def reference_element(order: ElementOrder, *, many_points: bool = False) -> ReferenceElement:
    """Return the tables of an element type, with a rule in each quarter of a face if asked."""
    face_points, face_weights = _triangle_rule()
    if many_points:
        quarters = 0.5 * np.stack([*(np.eye(3) + corner for corner in np.eye(3)), 1.0 - np.eye(3)])
        face_points = (face_points @ quarters).reshape(-1, 3)
        face_weights = np.tile(0.25 * face_weights, 4)
    if order is ElementOrder.P1:
        points, weights = np.full((1, 4), 0.25), np.ones(1)
        face_values = face_points
        face_gradients = np.tile(_TRIANGLE_GRADIENTS, (len(face_points), 1, 1))
    else:
        # The degree-two rule.
        near, far = (5.0 + 3.0 * np.sqrt(5.0)) / 20.0, (5.0 - np.sqrt(5.0)) / 20.0
        points, weights = np.full((4, 4), far) + (near - far) * np.eye(4), np.full(4, 0.25)
        face_values = quadratic_triangle_values(face_points)
        face_gradients = _quadratic_gradients(face_points, _TRIANGLE_GRADIENTS, FACE_EDGES)
    return ReferenceElement(
        order=order,
        gradients=shape_gradients(order, points),
        points=points,
        weights=weights,
        face_values=face_values,
        face_gradients=face_gradients,
        face_weights=face_weights,
        face_points=face_points,
    )


def shape_gradients(order: ElementOrder, barycentric: FloatArray) -> FloatArray:
    """Return shape functions' gradients in reference coordinates, shape [..., node_count, 3].

    At any points in barycentric coordinates, shape [..., 4].
    """
    if order is ElementOrder.P2:
        return _quadratic_gradients(barycentric, _TET_GRADIENTS, EDGES)
    return np.tile(_TET_GRADIENTS, (*barycentric.shape[:-1], 1, 1))


def quadratic_triangle_values(barycentric: FloatArray) -> FloatArray:
    """Return the six shape functions of a quadratic triangle at points [..., 3], shape [..., 6]."""
    corners = barycentric * (2.0 * barycentric - 1.0)
    middles = [4.0 * barycentric[..., a] * barycentric[..., b] for a, b in FACE_EDGES]
    return np.concatenate([corners, np.stack(middles, axis=-1)], axis=-1)


def quarter_hats(barycentric: FloatArray) -> FloatArray:
    """Return the linear shape functions of a quadratic face's four parts, shape [..., 6].

    They are nowhere negative and sum to one, at points in barycentric coordinates [..., 3].
    """
    corners = np.maximum(2.0 * barycentric - 1.0, 0.0)
    middles = []
    for a, b in FACE_EDGES:
        first, second, third = (barycentric[..., k] for k in (a, b, 3 - a - b))
        by_corner = np.where(first > 0.5, 2.0 * second, np.where(second > 0.5, 2.0 * first, 0.0))
        centre = barycentric.max(axis=-1) <= 0.5
        middles.append(np.where(centre, 1.0 - 2.0 * third, by_corner))
    return np.concatenate([corners, np.stack(middles, axis=-1)], axis=-1)


def quadratic_nodes(
    vertices: FloatArray, cells: IntArray, *, edges: Sequence[tuple[int, int]] = EDGES
) -> tuple[FloatArray, IntArray]:
    """Add the middles of the edges of every cell to nodes and cells, by default of tetrahedra."""
    ends, of_cells = edges_of(cells, edges)
    nodes = np.concatenate([vertices, vertices[ends].mean(axis=1)])
    return nodes, np.concatenate([cells, of_cells + len(vertices)], axis=1).astype(np.int32)


def edges_of(cells: IntArray, of: Sequence[tuple[int, int]] = EDGES) -> tuple[IntArray, IntArray]:
    """Return the nodes at the ends of all edges, sorted, shape [n, 2], and the edges of cells."""
    count = np.int64(cells.max() + 1)
    one, other = (cells[:, list(ends)] for ends in zip(*of, strict=True))
    keys = np.minimum(one, other) * count + np.maximum(one, other)
    found: Any = np.unique(keys, return_inverse=True)
    return np.column_stack(np.divmod(found[0], count)), found[1].reshape(len(cells), -1)


def boundary_faces(elements: IntArray) -> tuple[IntArray, IntArray]:
    """Find the faces that belong to one of the elements only, oriented outwards, and to which.

    Faces are of shape [face_count, 3 or 6]; elements, positively oriented, of shape
    [element_count, 4 or 10].
    """
    of_faces = FACES if elements.shape[1] == 4 else _QUADRATIC_FACES
    faces = np.concatenate([elements[:, list(face)] for face in of_faces])
    parents = np.tile(np.arange(len(elements), dtype=np.int32), len(FACES))
    keys = np.sort(faces[:, :3], axis=1) @ np.int64(faces.max() + 1) ** np.arange(3)
    _, first, counts = np.unique(keys, return_index=True, return_counts=True)
    outer = np.sort(first[counts == 1])
    return faces[outer], parents[outer]


def doubled_areas(nodes: FloatArray, faces: IntArray) -> FloatArray:
    """Return normals of faces as if they were flat, twice as long as their areas [m^2]."""
    a, b, c = (nodes[faces[:, k]] for k in range(3))
    return np.asarray(np.cross(b - a, c - a), dtype=np.float64)


def linear_facets(faces: IntArray) -> IntArray:
    """Split quadratic faces [n, 6] in four linear facets each; linear faces pass through."""
    if faces.shape[1] == 3:
        return faces
    return np.concatenate([faces[:, list(part)] for part in QUARTERS])


def _quadratic_gradients(
    barycentric: FloatArray, linear: FloatArray, edges: Sequence[tuple[int, int]]
) -> FloatArray:
    """Return quadratic shape functions' gradients from those of the linear ones at the corners."""
    at = barycentric[..., None]
    corners = (4.0 * at - 1.0) * linear
    middles = [4.0 * (at[..., a, :] * linear[b] + at[..., b, :] * linear[a]) for a, b in edges]
    return np.concatenate([corners, np.stack(middles, axis=-2)], axis=-2)


def _triangle_rule() -> tuple[FloatArray, FloatArray]:
    """Return Dunavant's degree-six rule of a triangle: points [12, 3] and weights [12]."""
    orbits = (0.249286745170910, 0.063089014491502)
    points = [q for b in orbits for q in ((1 - 2 * b, b, b), (b, 1 - 2 * b, b), (b, b, 1 - 2 * b))]
    a, b = 0.310352451033785, 0.053145049844816
    other = list(itertools.permutations((a, b, 1.0 - a - b)))
    weights = np.repeat([0.116786275726379, 0.050844906370207, 0.082851075618374], [3, 3, 6])
    return np.concatenate([points, other]), weights / weights.sum()
