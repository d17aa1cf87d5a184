"""Warp kernels of what a relaxing gel remembers.

The history is one tensor H a quadrature point, constant over a time step. It adds the energy
1/2 H : (F^T F - 1) a unit of rest volume, whose derivative is F H. A law that is not objective is
linear in F - 1, and so is its history: energy H : (F - 1), derivative H. All kernels launch over
[element_count, point_count] but ``add_hessian``.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import warp as wp

from sim.material.elasticity import GelArrays, deformation_gradient
from sim.material.laws.tangent import Law


@cache
def advance_kernel(law: Law) -> Any:
    """Build the kernel that carries a law's branches over a step."""
    law_stress, objective = law.stress, law.is_objective

    @wp.kernel(enable_backward=False, module="unique")
    def advance(
        # Model:
        gel: GelArrays,
        keeps: wp.array(dtype=wp.float64),
        gains: wp.array(dtype=wp.float64),
        # Data in:
        positions: wp.array(dtype=wp.vec3d),
        # Data out:
        stress_out: wp.array2d(dtype=wp.mat33d),
        branches_out: wp.array3d(dtype=wp.mat33d),
    ):
        e, q = wp.tid()
        F = deformation_gradient(gel, positions, e, q)
        S = law_stress(F, gel.parameters[0, e])
        if wp.static(objective):
            S = wp.inverse(F) * S
        for k in range(keeps.shape[0]):
            rise = (S - stress_out[e, q]) * gains[k]
            branches_out[k, e, q] = branches_out[k, e, q] * keeps[k] + rise
        stress_out[e, q] = S

    return advance


@wp.kernel(enable_backward=False)
def recall(
    # Model:
    keeps: wp.array(dtype=wp.float64),
    gains: wp.array(dtype=wp.float64),
    ratios: wp.array2d(dtype=wp.float64),
    # Data in:
    stress: wp.array2d(dtype=wp.mat33d),
    branches: wp.array3d(dtype=wp.mat33d),
    # Data out:
    history_out: wp.array2d(dtype=wp.mat33d),
):
    """Sum what the branches bring into a step: H [Pa]."""
    e, q = wp.tid()
    total = wp.mat33d()
    for k in range(keeps.shape[0]):
        total += (branches[k, e, q] * keeps[k] - stress[e, q] * gains[k]) * ratios[k, e]
    history_out[e, q] = total


@wp.kernel(enable_backward=False)
def add_hessian(
    # Model:
    blocks: wp.array3d(dtype=wp.int32),
    gel: GelArrays,
    # Data in:
    projected: wp.bool,
    # Data out:
    values_out: wp.array(dtype=wp.mat33d),
):
    """Add (g . H h) 1 for each pair of nodes; launches over [element_count, element_node_count]."""
    e, i = wp.tid()
    inverse = wp.transpose(gel.inverse_jacobians[e])
    for q in range(gel.reference_gradients.shape[0]):
        H = gel.history[e, q]
        if projected:
            H = _semidefinite(H)
        pulled = (H * (inverse * gel.reference_gradients[q, i])) * gel.weights[e, q]
        for j in range(i, blocks.shape[2]):
            slot = blocks[e, i, j]
            if slot >= 0:
                s = wp.dot(pulled, inverse * gel.reference_gradients[q, j])
                wp.atomic_add(values_out, slot // 2, wp.identity(n=3, dtype=wp.float64) * s)


@wp.func
def _semidefinite(H: wp.mat33d) -> wp.mat33d:
    """Return the nearest symmetric matrix without negative eigenvalues."""
    vectors, values = wp.eig3((H + wp.transpose(H)) * wp.float64(0.5))
    zero = wp.float64(0.0)
    kept = wp.vec3d(wp.max(values[0], zero), wp.max(values[1], zero), wp.max(values[2], zero))
    return vectors * wp.diag(kept) * wp.transpose(vectors)
