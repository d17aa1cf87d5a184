"""Slope of a triangulated height field at its nodes, from quadratic fits to neighbouring nodes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from sim.arrays import FloatArray, IntArray

_QUADRATIC_TERMS = 5


def recover_gradients(
    positions: FloatArray, triangles: IntArray, *, touching: NDArray[np.bool_] | None = None
) -> FloatArray:
    """Fit z = z_i + g (x - x_i) + quadratic through two rings of neighbours of each node.

    The fit is exact for quadratic surfaces, so that linear and quadratic elements are treated
    alike: a quadratic face comes as its four linear facets, mid-edge nodes included. Nodes inside
    the contact patch are no neighbours of nodes on its edge or outside, because the slope jumps at
    a sharp rim: there the slope is that of the free gel.

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
