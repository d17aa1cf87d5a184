"""Warp functions of one element's forces, and of their change along a direction.

Forces are float64; their change, which only steers conjugate gradients, is float32, and takes the
law's tangent from where the forces kept it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import warp as wp

from sim.batch.kernels.gathering import Gathering, Layout, Numbering
from sim.device import Device, filled
from sim.material.elasticity import shape_gradients
from sim.material.laws.tangent import Law, Tangent, cofactor
from sim.mesh.discretisation import Discretisation
from sim.mesh.elements import ReferenceElement


@wp.func
def cofactor_rate(G: wp.mat33f, H: wp.mat33f) -> wp.mat33f:
    """Return the derivative of cof G along H."""
    return wp.matrix_from_cols(
        wp.cross(H[:, 1], G[:, 2]) + wp.cross(G[:, 1], H[:, 2]),
        wp.cross(H[:, 2], G[:, 0]) + wp.cross(G[:, 2], H[:, 0]),
        wp.cross(H[:, 0], G[:, 1]) + wp.cross(G[:, 0], H[:, 1]),
    )


@wp.struct
class BatchGel:
    """The gel of all environments.

    Attributes:
        rows: Unknowns of every element, shape [3 * element_node_count, element_count].
        inverse_jacobians: Row by row, shape [9, element_count].
        weights: Rest volume of every quadrature point [m^3], shape [point_count, element_count].
        parameters: The law's numbers in every environment, shape [environment_count].
        young: E in every environment [Pa].
    """

    rows: wp.array2d(dtype=wp.int32)
    inverse_jacobians: wp.array2d(dtype=wp.float64)
    weights: wp.array2d(dtype=wp.float64)
    parameters: wp.array(dtype=wp.vec4d)
    young: wp.array(dtype=wp.float64)


def batch_gel(
    pad: Discretisation,
    numbered: Numbering,
    law: Law,
    materials: Sequence[tuple[float, float]],
    device: Device,
) -> Any:
    """Upload a pad's gel: E [Pa] and nu of every environment."""
    parameters = [law.parameters(young_pa, poisson) for young_pa, poisson in materials]
    return filled(
        BatchGel,
        rows=device.array(numbered.of_nodes(pad.elements), wp.int32),
        inverse_jacobians=device.array(pad.inverse_jacobians.reshape(-1, 9).T, wp.float64),
        weights=device.array(pad.reference.weights[:, None] * pad.volumes, wp.float64),
        parameters=device.array(parameters, wp.vec4d),
        young=device.array([young_pa for young_pa, _ in materials], wp.float64),
    )


@wp.func
def inverse_jacobian(e: wp.int32, gel: BatchGel) -> wp.mat33d:
    """Return an element's."""
    m = wp.mat33d()
    for i in range(3):
        for j in range(3):
            m[i, j] = gel.inverse_jacobians[3 * i + j, e]
    return m


# Numbers that are kept of a point's tangent.
TANGENT_SIZE = 14


@wp.struct
class Tangents:
    """The law's tangent at every quadrature point of all environments.

    It only steers conjugate gradients, so that float16 will do.

    Attributes:
        values: F less one, then a, b, c, d and e of ``sim.material.laws.tangent`` over E, value
            by value, shape [environment_count, 14 * point_count * element_count].
    """

    values: wp.array2d(dtype=wp.float16)


@wp.func
def keep_tangent(
    b: wp.int32,
    place: wp.int32,
    stride: wp.int32,
    t: Tangent,
    F: wp.mat33d,
    young: wp.float64,
    tangents: Tangents,
):
    """Keep a point's tangent for the searches from this state."""
    for i in range(3):
        for j in range(3):
            value = F[i, j] - wp.where(i == j, wp.float64(1.0), wp.float64(0.0))
            tangents.values[b, place + (3 * i + j) * stride] = wp.float16(value)
    tangents.values[b, place + 9 * stride] = wp.float16(t.a / young)
    tangents.values[b, place + 10 * stride] = wp.float16(t.b / young)
    tangents.values[b, place + 11 * stride] = wp.float16(t.c / young)
    tangents.values[b, place + 12 * stride] = wp.float16(t.d / young)
    tangents.values[b, place + 13 * stride] = wp.float16(t.e / young)


@wp.func
def kept(b: wp.int32, place: wp.int32, tangents: Tangents) -> wp.float32:
    """Return one of a point's values."""
    return wp.float32(tangents.values[b, place])


@wp.func
def kept_stress_rate(
    b: wp.int32, place: wp.int32, stride: wp.int32, H: wp.mat33f, tangents: Tangents
) -> wp.mat33f:
    """Return the change of the first Piola-Kirchhoff stress along H, over E."""
    G = wp.identity(n=3, dtype=wp.float32)
    for i in range(3):
        for j in range(3):
            G[i, j] += kept(b, place + (3 * i + j) * stride, tangents)
    C = cofactor(G)
    along_deformation = wp.ddot(G, H)
    along_cofactor = wp.ddot(C, H)
    c = kept(b, place + 11 * stride, tangents)
    on_deformation = kept(b, place + 10 * stride, tangents) * along_deformation + c * along_cofactor
    on_cofactor = c * along_deformation + kept(b, place + 12 * stride, tangents) * along_cofactor
    return (
        H * kept(b, place + 9 * stride, tangents)
        + G * on_deformation
        + C * on_cofactor
        + cofactor_rate(G, H) * kept(b, place + 13 * stride, tangents)
    )


def forces_function(law: Law, reference: ReferenceElement) -> Any:
    """Build the function that gives an element's nodal forces, and keeps its tangents."""
    law_stress, law_tangent = law.stress, law.tangent
    gradients, node_count = shape_gradients(reference), reference.node_count
    NodeVectors = wp.types.matrix(shape=(node_count, 3), dtype=wp.float64)

    @wp.func
    def element_forces(
        e: wp.int32, b: wp.int32, gel: BatchGel, displacements: Any, tangents: Tangents
    ):
        inverse = inverse_jacobian(e, gel)
        p = gel.parameters[b]
        total = NodeVectors()
        for q in range(wp.static(len(gradients))):
            D = wp.mat33d()
            for k in range(wp.static(node_count)):
                # Read anew at every point: float64 fills the registers as it is.
                u0 = displacements[gel.rows[3 * k, e]]
                u1 = displacements[gel.rows[3 * k + 1, e]]
                u2 = displacements[gel.rows[3 * k + 2, e]]
                for j in range(3):
                    if wp.static(gradients[q][k][j] != 0.0):
                        g = wp.float64(wp.static(gradients[q][k][j]))
                        D[0, j] += u0 * g
                        D[1, j] += u1 * g
                        D[2, j] += u2 * g
            F = wp.identity(n=3, dtype=wp.float64) + D * inverse
            weight = gel.weights[q, e]
            place = q * gel.weights.shape[1] + e
            keep_tangent(
                b,
                place,
                gel.weights.shape[0] * gel.weights.shape[1],
                law_tangent(F, p),
                F,
                gel.young[b],
                tangents,
            )
            K = (law_stress(F, p) * wp.transpose(inverse)) * weight
            for k in range(wp.static(node_count)):
                for j in range(3):
                    if wp.static(gradients[q][k][j] != 0.0):
                        for axis in range(3):
                            total[k, axis] += K[axis, j] * wp.float64(wp.static(gradients[q][k][j]))
        return total

    return element_forces


def rates_function(reference: ReferenceElement) -> Any:
    """Build the function that gives their change along a direction, by the kept tangents."""
    gradients, node_count = shape_gradients(reference), reference.node_count
    NodeVectors = wp.types.matrix(shape=(node_count, 3), dtype=wp.float32)

    @wp.func
    def element_rates(e: wp.int32, b: wp.int32, gel: BatchGel, directions: Any, tangents: Tangents):
        inverse = wp.mat33f(inverse_jacobian(e, gel))
        young = wp.float32(gel.young[b])
        along = NodeVectors()
        total = NodeVectors()
        for k in range(wp.static(node_count)):
            for axis in range(3):
                along[k, axis] = directions[gel.rows[3 * k + axis, e]]
        for q in range(wp.static(len(gradients))):
            S = wp.mat33f()
            for k in range(wp.static(node_count)):
                for j in range(3):
                    if wp.static(gradients[q][k][j] != 0.0):
                        for axis in range(3):
                            S[axis, j] += along[k, axis] * wp.float32(wp.static(gradients[q][k][j]))
            place = q * gel.weights.shape[1] + e
            P = kept_stress_rate(
                b, place, gel.weights.shape[0] * gel.weights.shape[1], S * inverse, tangents
            )
            K = (P * wp.transpose(inverse)) * (young * wp.float32(gel.weights[q, e]))
            for k in range(wp.static(node_count)):
                for j in range(3):
                    if wp.static(gradients[q][k][j] != 0.0):
                        for axis in range(3):
                            total[k, axis] += K[axis, j] * wp.float32(wp.static(gradients[q][k][j]))
        return total

    return element_rates


def room_for(reference: ReferenceElement, layout: Layout) -> int:
    """Return the places that a chunk takes: one for every nodal component, and one for a zero."""
    return 3 * reference.node_count * layout.chunk + 1


def hand_over_function(of_element: Any, reference: ReferenceElement, layout: Layout) -> Any:
    """Build the function.

    Args:
        of_element: Gives an element's nodal forces, or their change, at displacements or along
            directions in shared memory.
    """
    node_count, chunk = reference.node_count, layout.chunk

    @wp.func
    def hand_over(
        c: wp.int32,
        b: wp.int32,
        thread: wp.int32,
        gel: BatchGel,
        at: Any,
        tangents: Tangents,
        gathering: Gathering,
        contributions: Any,
    ):
        last = gathering.element_count - 1
        for i in range(thread, wp.static(chunk), wp.block_dim()):
            e = c * wp.static(chunk) + i
            total = of_element(wp.min(e, last), b, gel, at, tangents)
            for k in range(wp.static(node_count)):
                for axis in range(3):
                    place = (3 * k + axis) * wp.static(chunk) + i
                    wp.tile_scatter_masked(contributions, place, total[k, axis], e <= last)

    return hand_over
