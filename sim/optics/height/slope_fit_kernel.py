"""Slope of a mesh of linear facets at its nodes, by quadratic fits to two rings of neighbours."""

from __future__ import annotations

import numpy as np
import warp as wp
from scipy import sparse

from sim.optics.height.node_kernel import FREE, TOUCHES, Canvas, Gel
from tacauchy_rig.core.arrays import IntArray

_TERMS = wp.constant(5)
_Normal = wp.types.matrix(shape=(5, 5), dtype=wp.float64)
_Load = wp.types.vector(length=5, dtype=wp.float64)
# Of the matrix' trace: on slopes, and on curvatures, which few neighbours do not settle.
_RIDGE_SLOPE = wp.constant(wp.float64(1.0e-9))
_RIDGE_CURVATURE = wp.constant(wp.float64(1.0e-6))
# Added to squared distances over the mean one, so that no neighbour counts for all.
_NEAREST = wp.constant(wp.float64(1.0e-3))
_TRACE_LEAST = wp.constant(wp.float64(1.0e-12))


@wp.func
def _solved(matrix: _Normal, load: _Load):
    """Eliminate without pivoting: the matrix is positive definite."""
    for i in range(_TERMS):
        for j in range(i + 1, _TERMS):
            factor = matrix[j, i] / matrix[i, i]
            for k in range(i, _TERMS):
                matrix[j, k] = matrix[j, k] - factor * matrix[i, k]
            load[j] = load[j] - factor * load[i]
    for back in range(_TERMS):
        i = _TERMS - 1 - back
        for k in range(i + 1, _TERMS):
            load[i] = load[i] - matrix[i, k] * load[k]
        load[i] = load[i] / matrix[i, i]
    return load


@wp.func
def _counts(state: int, neighbour: int):
    """Return whether a neighbour has a say: nodes inside the contact have none outside of it."""
    inside = state & (TOUCHES | FREE) == TOUCHES
    return inside or neighbour & (TOUCHES | FREE) != TOUCHES


@wp.kernel(enable_backward=False)
def fit_slopes(gel: Gel, canvas: Canvas):
    """Fit z = z_i + g (x - x_i) + quadratic around each node; exact for quadratic surfaces.

    Nodes inside the contact are no neighbours of nodes on its edge or outside, because the slope
    jumps at a sharp rim: there the slope is that of the free gel.
    """
    env, i = wp.tid()
    one = wp.float64(1.0)
    x, state = canvas.nodes[env, i], canvas.states[env, i]
    total, count = wp.float64(0.0), wp.float64(0.0)
    for n in range(gel.neighbour_starts[i], gel.neighbour_starts[i + 1]):
        other = gel.neighbours[n]
        if _counts(state, canvas.states[env, other]):
            d = canvas.nodes[env, other] - x
            total += wp.sqrt(d[0] * d[0] + d[1] * d[1])
            count += one
    radius = wp.where(total > wp.float64(0.0), total / wp.max(count, one), one)
    normal, load = _Normal(), _Load()
    for n in range(gel.neighbour_starts[i], gel.neighbour_starts[i + 1]):
        other = gel.neighbours[n]
        if _counts(state, canvas.states[env, other]):
            d = (canvas.nodes[env, other] - x) / radius
            weight = one / (d[0] * d[0] + d[1] * d[1] + _NEAREST)
            basis = _Load(d[0], d[1], d[0] * d[0], d[0] * d[1], d[1] * d[1])
            load += weight * d[2] * basis
            normal += weight * wp.outer(basis, basis)
    trace = wp.trace(normal) + _TRACE_LEAST
    for k in range(_TERMS):
        normal[k, k] = normal[k, k] + trace * wp.where(k < 2, _RIDGE_SLOPE, _RIDGE_CURVATURE)
    fitted = _solved(normal, load)
    canvas.sums[env, i] = wp.vec3d(fitted[0], fitted[1], one)


def two_rings(triangles: IntArray, node_count: int) -> dict[str, IntArray]:
    """Return the nodes at most two edges from each node, as tables of ``node_kernel.Gel``."""
    start = triangles[:, [0, 1, 2, 1, 2, 0]].ravel()
    end = triangles[:, [1, 2, 0, 0, 1, 2]].ravel()
    one_ring = sparse.csr_matrix((np.ones(len(start)), (start, end)), shape=(node_count,) * 2)
    rings = (one_ring + one_ring @ one_ring).tolil()
    rings.setdiag(0.0)
    found = rings.tocsr()
    found.eliminate_zeros()
    return {"neighbour_starts": found.indptr, "neighbours": found.indices}
