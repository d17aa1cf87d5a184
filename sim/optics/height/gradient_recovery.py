"""Slope of a height field on a mesh at its nodes.

From linear facets by quadratic fits to neighbouring nodes, from quadratic faces by averaging the
faces' own slopes, which keeps to one ring where a graded mesh gets coarse.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from sim.arrays import FloatArray, IntArray
from sim.mesh.elements import quadratic_triangle_gradients

# The nodes of a quadratic face, barycentric.
FACE_NODES = np.concatenate([np.eye(3), 0.5 * (np.eye(3) + np.roll(np.eye(3), 1, axis=1))])
_QUADRATIC_TERMS = 5
_FLAT_M2 = 1e-18


def node_gradients(
    positions: FloatArray,
    triangles: IntArray,
    triangles6: IntArray | None,
    touching: NDArray[np.bool_] | None,
) -> FloatArray:
    """Return dz/dx and dz/dy at the nodes by what suits the element, shape [node_count, 2]."""
    if triangles6 is None:
        return recover_gradients(positions, triangles, touching=touching)
    return average_face_gradients(positions, triangles6, touching=touching)


def recover_gradients(
    positions: FloatArray, triangles: IntArray, *, touching: NDArray[np.bool_] | None = None
) -> FloatArray:
    """Fit z = z_i + g (x - x_i) + quadratic through two rings of neighbours of each node.

    The fit is exact for quadratic surfaces. Nodes inside the contact patch are no neighbours of
    nodes on its edge or outside, because the slope jumps at a sharp rim: there the slope is that
    of the free gel.

    Args:
        positions: Deformed nodes [m], shape [node_count, 3].
        triangles: Facets, shape [facet_count, 3].
        touching: True for nodes on the indenter, shape [node_count].

    Returns:
        dz/dx and dz/dy at each node, shape [node_count, 2].
    """
    node_count = len(positions)
    centre, neighbour = _two_rings(node_count, triangles)
    if touching is not None:
        interior = touching & ~nodes_of(triangles[~touching[triangles].all(axis=1)], node_count)
        keep = interior[centre] | ~interior[neighbour]
        centre, neighbour = centre[keep], neighbour[keep]

    offset = positions[neighbour] - positions[centre]
    radius = _mean_by_node(np.hypot(offset[:, 0], offset[:, 1]), centre, node_count)
    dx, dy, dz = (offset / radius[centre, None]).T
    weight = 1.0 / (dx * dx + dy * dy + 1e-3)
    basis = np.stack([dx, dy, dx * dx, dx * dy, dy * dy], axis=1)
    normal = np.zeros((node_count, _QUADRATIC_TERMS, _QUADRATIC_TERMS))
    load = np.zeros((node_count, _QUADRATIC_TERMS))
    for i in range(_QUADRATIC_TERMS):
        column = weight * basis[:, i]
        load[:, i] = np.bincount(centre, column * dz, minlength=node_count)
        for j in range(i, _QUADRATIC_TERMS):
            total = np.bincount(centre, column * basis[:, j], minlength=node_count)
            normal[:, i, j] = normal[:, j, i] = total
    trace = np.trace(normal, axis1=1, axis2=2)[:, None] + 1e-12
    ridge = trace * np.array([1e-9, 1e-9, 1e-6, 1e-6, 1e-6])
    normal[:, range(_QUADRATIC_TERMS), range(_QUADRATIC_TERMS)] += ridge
    return np.asarray(np.linalg.solve(normal, load[:, :, None])[:, :2, 0])


def average_face_gradients(
    positions: FloatArray, triangles6: IntArray, *, touching: NDArray[np.bool_] | None = None
) -> FloatArray:
    """Average the slopes of the quadratic faces at each node, weighted by their areas.

    Faces that touch with all their nodes do not count at the edge of the contact.

    Args:
        positions: Deformed nodes [m], shape [node_count, 3].
        triangles6: Faces: corners, then nodes on the edges 01, 12, 20, shape [face_count, 6].
        touching: True for nodes on the indenter, shape [node_count].

    Returns:
        dz/dx and dz/dy at each node, shape [node_count, 2]; zero at nodes of no face.
    """
    node_count = len(positions)
    nodes = positions[triangles6]
    along = np.einsum("qkn,fnd->fqkd", shape_derivatives(), nodes)
    determinant = along[:, :, 0, 0] * along[:, :, 1, 1] - along[:, :, 0, 1] * along[:, :, 1, 0]
    safe = np.where(np.abs(determinant) > _FLAT_M2, determinant, np.inf)
    dx = (along[:, :, 1, 1] * along[:, :, 0, 2] - along[:, :, 0, 1] * along[:, :, 1, 2]) / safe
    dy = (along[:, :, 0, 0] * along[:, :, 1, 2] - along[:, :, 1, 0] * along[:, :, 0, 2]) / safe
    weight = np.abs(determinant)
    if touching is not None:
        pressed = np.all(touching[triangles6], axis=1, keepdims=True)
        free = nodes_of(triangles6[np.flatnonzero(~pressed)], node_count)
        weight = np.where(pressed & free[triangles6], 0.0, weight)
    flat = triangles6.ravel()
    total = np.maximum(np.bincount(flat, weight.ravel(), minlength=node_count), _FLAT_M2**2)
    sums = [np.bincount(flat, (weight * g).ravel(), minlength=node_count) for g in (dx, dy)]
    return np.stack(sums, axis=1) / total[:, None]


def shape_derivatives() -> FloatArray:
    """Return d(shape functions)/d(s, t) at the six nodes, shape [6 nodes, 2, 6 functions]."""
    return np.stack([quadratic_triangle_gradients(place).T for place in FACE_NODES])


def nodes_of(triangles: IntArray, node_count: int) -> NDArray[np.bool_]:
    """Mark the nodes that belong to any of the facets, shape [node_count]."""
    marked = np.zeros(node_count, dtype=np.bool_)
    marked[triangles.ravel()] = True
    return marked


def _two_rings(node_count: int, triangles: IntArray) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return all pairs (node, neighbour) at most two edges apart."""
    start = triangles[:, [0, 1, 2, 1, 2, 0]].ravel()
    end = triangles[:, [1, 2, 0, 0, 1, 2]].ravel()
    one_ring = sparse.csr_matrix((np.ones(len(start)), (start, end)), shape=(node_count,) * 2)
    rings = (one_ring + one_ring @ one_ring).tocoo()
    distinct = rings.row != rings.col
    return rings.row[distinct], rings.col[distinct]


def _mean_by_node(values: FloatArray, node: NDArray[np.int32], node_count: int) -> FloatArray:
    total = np.bincount(node, values, minlength=node_count)
    count = np.bincount(node, minlength=node_count)
    return np.where(count > 0, total / np.maximum(count, 1), 1.0)
