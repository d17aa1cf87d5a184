"""Warp kernels of the elastic energy, its gradient and its assembled Hessian.

One set of kernels a law; every element order runs through them.
"""

from functools import cache
from typing import Any

import numpy as np
import warp as wp

from sim.device import constant_table, repeatable, start_warp
from sim.material.laws.law_and_lame import Law, Tangent, block_of, cofactor
from sim.mesh.elements import ElementOrder, reference_element

start_warp()


# Volume ratio below which a point remembers no more than at it.
_CRUSHED = wp.constant(wp.float64(0.05))
# Blocks of a node with every one of an element.
_Blocks = wp.types.matrix(shape=(10, 9), dtype=wp.float64)
# Rounding leaves so much of a gradient that is zero.
_ZERO = 1e-14


@wp.struct
class GelArrays:
    """A gel's elements on a device."""

    nodes: wp.array2d(dtype=wp.int32)  # of every element, shape [element_count, node_count]
    # of the shape functions, shape [point_count, node_count]
    reference_gradients: wp.array2d(dtype=wp.vec3d)
    inverse_jacobians: wp.array(dtype=wp.mat33d)  # at rest [1/m], shape [element_count]
    # rest volume of every quadrature point [m^3], shape [element_count, point_count]
    weights: wp.array2d(dtype=wp.float64)
    # the law's numbers, shape [environment_count, element_count]
    parameters: wp.array2d(dtype=wp.vec4d)
    # c of every element, by which relaxation stiffens a step; one where nothing does
    stiffening: wp.array(dtype=wp.float64)
    # H of every quadrature point [Pa], what it remembers; empty where it does not
    history: wp.array2d(dtype=wp.mat33d)
    shift: wp.float64  # of ``repeatable`` for the nodes' forces [N]


@wp.func
def deformation_gradient(
    gel: GelArrays, positions: wp.array(dtype=wp.vec3d), element: wp.int32, point: wp.int32
) -> wp.mat33d:
    """Return F = dx/dX of an element at one of its points."""
    D = wp.mat33d()
    for node in range(gel.nodes.shape[1]):
        D += wp.outer(positions[gel.nodes[element, node]], gel.reference_gradients[point, node])
    return D * gel.inverse_jacobians[element]


@wp.func
def cauchy(P: wp.mat33d, F: wp.mat33d) -> wp.mat33d:
    """Return sigma = P F^T / J [Pa] (paper, Eq. 3)."""
    return (P * wp.transpose(F)) * (wp.float64(1.0) / wp.determinant(F))


@cache
def tangent_kernel(law: Law, *, remembers: bool) -> Any:
    """Build what gives a law's ``Tangent`` and the history H that ``hessian`` takes, times weights.

    The kernel launches over [element_count, point_count]. Warp compiles kernels at their first
    launch and keeps the result.
    """
    law_tangent, bends = law.tangent, remembers and law.is_objective

    @wp.kernel(enable_backward=False, module="unique")
    def tangent(
        # Model:
        gel: GelArrays,
        # Data in:
        positions: wp.array(dtype=wp.vec3d),
        projected: wp.bool,
        # Data out:
        tangent_out: wp.array2d(dtype=Tangent),
        history_out: wp.array2d(dtype=wp.mat33d),
    ):
        e, q = wp.tid()
        F = deformation_gradient(gel, positions, e, q)
        t = law_tangent(F, gel.parameters[0, e])
        if projected:
            t = semidefinite(t)
        w = gel.weights[e, q] * gel.stiffening[e]
        t.a = t.a * w
        t.b = t.b * w
        t.c = t.c * w
        t.d = t.d * w
        t.e = t.e * w
        tangent_out[e, q] = t
        if wp.static(bends):
            H = gel.history[e, q] * gel.weights[e, q]
            if projected:
                H = _without_negative(H)
            history_out[e, q] = H

    return tangent


@cache
def stress_kernel(law: Law, *, remembers: bool = False, slow: bool = False) -> Any:
    """Build what gives the Cauchy stress [Pa]; see ``element_kernel``.

    It launches over [environment_count, element_count, point_count].

    Args:
        slow: Give the S = F^-1 P that relaxation goes by instead; P of a law not objective. S has
            no limit as a point's volume goes to nothing, where P has one. Below a twentieth of the
            volume at rest it is cof(F)^T P over that, so that what is crushed or inside out on its
            way remembers something finite.
    """
    law_stress, objective = law.stress, law.is_objective

    @wp.kernel(enable_backward=False, module="unique")
    def stress(
        # Model:
        gel: GelArrays,
        # Data in:
        positions: wp.array2d(dtype=wp.vec3d),
        # Data out:
        stress_out: wp.array3d(dtype=wp.mat33d),
    ):
        b, e, q = wp.tid()
        F = deformation_gradient(gel, positions[b], e, q)
        total = law_stress(F, gel.parameters[b, e])
        if wp.static(not slow):
            total = cauchy(total, F)
        elif wp.static(objective):
            total = wp.transpose(cofactor(F)) * total / wp.max(wp.determinant(F), _CRUSHED)
        if wp.static(remembers):
            H = gel.history[e, q]
            if wp.static(objective):
                H = F * H
            total = total * gel.stiffening[e] + cauchy(H, F)
        stress_out[b, e, q] = total

    return stress


@wp.func
def semidefinite(t: Tangent) -> Tangent:
    """Shrink the geometric term until the tangent cannot be indefinite.

    The spectrum of d2J/dF2 lies within twice the largest singular value of F, which its Frobenius
    norm bounds; no singular value decomposition is needed, at the price of a stiffer step.
    """
    bound = wp.float64(2.0) * wp.sqrt(wp.ddot(t.deformation, t.deformation))
    limit = t.a / wp.max(bound, wp.float64(1.0e-30))
    t.e = wp.clamp(t.e, -limit, limit)
    t.c = wp.float64(0.0)
    return t


@wp.func
def _without_negative(H: wp.mat33d) -> wp.mat33d:
    """Return the nearest symmetric matrix without negative eigenvalues."""
    vectors, values = wp.eig3((H + wp.transpose(H)) * wp.float64(0.5))
    zero = wp.float64(0.0)
    kept = wp.vec3d(wp.max(values[0], zero), wp.max(values[1], zero), wp.max(values[2], zero))
    return vectors * wp.diag(kept) * wp.transpose(vectors)


@wp.kernel(enable_backward=False, module="unique")
def hessian(
    # Model:
    gel: GelArrays,
    blocks: wp.array3d(dtype=wp.int32),
    # Data in:
    tangents: wp.array2d(dtype=Tangent),
    history: wp.array2d(dtype=wp.mat33d),
    # Data out:
    values_out: wp.array(dtype=wp.mat33d),
):
    """Add an element's blocks to the matrix; ``blocks`` holds 2 * index + transposed, or -1.

    A history H of an objective law adds g . H h of the shape gradients g and h.
    """
    e, i = wp.tid()
    inverse = wp.transpose(gel.inverse_jacobians[e])
    total = _Blocks()
    for q in range(tangents.shape[1]):
        g = inverse * gel.reference_gradients[q, i]
        by_gradient = block_of(tangents[e, q], g)
        if history.shape[0] > 0:
            bent = history[e, q] * g
            for k in range(3):
                for diagonal in range(3):
                    by_gradient[4 * diagonal, k] += bent[k]
        for j in range(i, blocks.shape[2]):
            added = by_gradient * (inverse * gel.reference_gradients[q, j])
            for k in range(9):
                total[j, k] += added[k]
    for j in range(i, blocks.shape[2]):
        slot = blocks[e, i, j]
        if slot >= 0:
            block = wp.mat33d()
            for k in range(3):
                for m in range(3):
                    block[k, m] = total[j, 3 * k + m]
            if slot % 2 == 1:
                block = wp.transpose(block)
            wp.atomic_add(values_out, slot // 2, block)


@cache
def element_kernel(law: Law, order: ElementOrder, *, remembers: bool) -> Any:
    """Build the kernel of a law's energy and forces.

    It launches over [environment_count, element_count], leaves environments alone that are not
    ``wanted``, and adds to the gradient.

    Args:
        remembers: The gel relaxes: its history H, constant over a step, adds H : (F^T F - 1) / 2
            to the energy, or H : (F - 1) where the law is not objective.
    """
    law_energy, law_stress, objective = law.energy, law.stress, law.is_objective
    reference = reference_element(order)
    # By quadrature point, node and reference coordinate, as the kernel compiles them in.
    gradients = constant_table(
        np.where(np.abs(reference.gradients) < _ZERO, 0.0, reference.gradients)
    )
    point_count, node_count = len(reference.gradients), reference.node_count
    NodeVectors = wp.types.matrix(shape=(node_count, 3), dtype=wp.float64)

    @wp.kernel(enable_backward=False, module="unique")
    def element(
        # Model:
        gel: GelArrays,
        # Data in:
        wanted: wp.array(dtype=wp.int32),
        positions: wp.array2d(dtype=wp.vec3d),
        # Data out:
        gradient_out: wp.array2d(dtype=wp.vec3d),
        energy_out: wp.array2d(dtype=wp.float64),
        volume_ratio_out: wp.array2d(dtype=wp.float64),
    ):
        b, e = wp.tid()
        if wanted[b] == 0:
            return
        inverse = gel.inverse_jacobians[e]
        p = gel.parameters[b, e]
        at = NodeVectors()
        total = NodeVectors()
        energy = wp.float64(0.0)
        least = wp.float64(1.0e300)
        for k in range(wp.static(node_count)):
            x = positions[b, gel.nodes[e, k]]
            for axis in range(3):
                at[k, axis] = x[axis]
        for q in range(wp.static(point_count)):
            D = wp.mat33d()
            for k in range(wp.static(node_count)):
                for j in range(3):
                    g = gradients((q * wp.static(node_count) + k) * 3 + j)
                    if g != wp.float64(0.0):
                        for axis in range(3):
                            D[axis, j] += at[k, axis] * g
            F = D * inverse
            P = law_stress(F, p)
            density = law_energy(F, p)
            if wp.static(remembers):
                c = gel.stiffening[e]
                P = P * c
                density = density * c
                H = gel.history[e, q]
                strain = F - wp.identity(n=3, dtype=wp.float64)
                if wp.static(objective):
                    # Green's strain from F - 1, so that small strains keep their digits.
                    twice = strain + wp.transpose(strain) + wp.transpose(strain) * strain
                    density += wp.ddot(H, twice) * wp.float64(0.5)
                    P += F * H
                else:
                    density += wp.ddot(H, strain)
                    P += H
            weight = gel.weights[e, q]
            energy += weight * density
            least = wp.min(least, wp.determinant(F))
            K = (P * wp.transpose(inverse)) * weight
            for k in range(wp.static(node_count)):
                for j in range(3):
                    g = gradients((q * wp.static(node_count) + k) * 3 + j)
                    if g != wp.float64(0.0):
                        for axis in range(3):
                            total[k, axis] += K[axis, j] * g
        energy_out[b, e] = energy
        volume_ratio_out[b, e] = least
        for k in range(wp.static(node_count)):
            node_total = wp.vec3d(total[k, 0], total[k, 1], total[k, 2])
            wp.atomic_add(gradient_out, b, gel.nodes[e, k], repeatable(node_total, gel.shift))

    return element
