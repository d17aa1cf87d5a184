"""Warp kernels of what a relaxing gel remembers.

The history is one tensor H a quadrature point, constant over a time step. It adds the energy
1/2 H : (F^T F - 1) a unit of rest volume, whose derivative is F H. A law that is not objective is
linear in F - 1, and so is its history: energy H : (F - 1), derivative H. All kernels launch over
[element_count, point_count].

S = F^-1 P has no limit as a point's volume goes to nothing, where P has one. Below a twentieth of
the volume at rest it is cof(F)^T P over that, so that what is crushed or inside out on its way
remembers something finite.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import warp as wp

from sim.material.elasticity import GelArrays, deformation_gradient
from sim.material.laws.tangent import Law, cofactor

# Volume ratio below which a point remembers no more than at it.
_CRUSHED = wp.constant(wp.float64(0.05))


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
            S = wp.transpose(cofactor(F)) * S / wp.max(wp.determinant(F), _CRUSHED)
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
