"""Warp kernel of a batch's forces: at its displacements, or their change along its directions.

Which of the two an environment needs is its phase. Gel and contact are one launch: alone, neither
of them fills a GPU.
"""

# Device code: Warp compiles it, and Python type checkers do not speak its dialect.
# mypy: ignore-errors
# ruff: noqa: SIM109 - device code has no membership test

from __future__ import annotations

from functools import cache
from typing import Any

import warp as wp

from sim.arrays import FloatArray
from sim.batch.contact_kernel import BatchContact, BatchSurface, add_contact
from sim.batch.nodal import add_vector, node_vector
from sim.batch.phases import EVALUATE, SEARCH
from sim.device import Device
from sim.discretisation import Discretisation
from sim.laws.tangent import Law, Tangent
from sim.warp_start import start_warp

start_warp()


@wp.func
def cofactor_rate(G: wp.mat33d, H: wp.mat33d) -> wp.mat33d:
    """Return the derivative of cof G along H."""
    g0 = wp.vec3d(G[0, 0], G[1, 0], G[2, 0])
    g1 = wp.vec3d(G[0, 1], G[1, 1], G[2, 1])
    g2 = wp.vec3d(G[0, 2], G[1, 2], G[2, 2])
    h0 = wp.vec3d(H[0, 0], H[1, 0], H[2, 0])
    h1 = wp.vec3d(H[0, 1], H[1, 1], H[2, 1])
    h2 = wp.vec3d(H[0, 2], H[1, 2], H[2, 2])
    return wp.matrix_from_cols(
        wp.cross(h1, g2) + wp.cross(g1, h2),
        wp.cross(h2, g0) + wp.cross(g2, h0),
        wp.cross(h0, g1) + wp.cross(g0, h1),
    )


@wp.func
def stress_rate(t: Tangent, H: wp.mat33d) -> wp.mat33d:
    """Return the derivative of the first Piola-Kirchhoff stress along H."""
    along_deformation = wp.ddot(t.deformation, H)
    along_cofactor = wp.ddot(t.cofactor, H)
    return (
        H * t.a
        + t.deformation * (t.b * along_deformation + t.c * along_cofactor)
        + t.cofactor * (t.c * along_deformation + t.d * along_cofactor)
        + cofactor_rate(t.deformation, H) * t.e
    )


@wp.struct
class BatchGel:
    """The gel of all environments.

    Attributes:
        elements: Nodes, shape [element_count, element_node_count].
        rows: Unknown of every nodal component, -1 where it is fixed, shape [node_count, 3].
        gradients: Shape function gradients in reference coordinates, [point_count, node_count].
        inverse_jacobians: Shape [element_count].
        weights: Rest volume of every quadrature point [m^3], shape [element_count, point_count].
        parameters: The law's numbers in every environment, shape [environment_count].
        shares: Threads that share an element's quadrature points.
    """

    elements: wp.array2d(dtype=wp.int32)
    rows: wp.array2d(dtype=wp.int32)
    gradients: wp.array2d(dtype=wp.vec3d)
    inverse_jacobians: wp.array(dtype=wp.mat33d)
    weights: wp.array2d(dtype=wp.float64)
    parameters: wp.array(dtype=wp.vec4d)
    shares: wp.int32


def batch_gel(
    pad: Discretisation, rows: Any, parameters: FloatArray, *, shares: int, device: Device
) -> Any:
    """Upload a pad's gel; ``rows`` is on the device already."""
    gel = BatchGel()
    gel.elements = device.array(pad.elements, wp.int32)
    gel.rows = rows
    gel.gradients = device.array(pad.reference.gradients, wp.vec3d)
    gel.inverse_jacobians = device.array(pad.inverse_jacobians, wp.mat33d)
    gel.weights = device.array(pad.volumes[:, None] * pad.reference.weights, wp.float64)
    gel.parameters = device.array(parameters, wp.vec4d)
    gel.shares = shares
    return gel


def element_function(law: Law, node_count: int) -> Any:
    """Build the function by which a law's elements of so many nodes add their forces."""
    law_stress, law_tangent = law.stress, law.tangent
    NodeVectors = wp.types.matrix(shape=(node_count, 3), dtype=wp.float64)

    @wp.func
    def add_element(
        e: wp.int32,
        share: wp.int32,
        b: wp.int32,
        phase: wp.int32,
        gel: BatchGel,
        displacements: wp.array2d(dtype=wp.float64),
        directions: wp.array2d(dtype=wp.float32),
        forces_out: wp.array2d(dtype=wp.float64),
    ):
        inverse = gel.inverse_jacobians[e]
        p = gel.parameters[b]
        one = wp.identity(n=3, dtype=wp.float64)
        # Read once: read anew at every point, the same took twice as long on an H100.
        at = NodeVectors()
        along = NodeVectors()
        total = NodeVectors()
        for k in range(wp.static(node_count)):
            u = node_vector(displacements, gel.rows, gel.elements[e, k], b)
            for axis in range(3):
                at[k, axis] = u[axis]
        if phase == SEARCH:
            for k in range(wp.static(node_count)):
                v = node_vector(directions, gel.rows, gel.elements[e, k], b)
                for axis in range(3):
                    along[k, axis] = v[axis]
        for q in range(share, gel.weights.shape[1], gel.shares):
            D = wp.mat33d()
            for k in range(wp.static(node_count)):
                D += wp.outer(at[k], gel.gradients[q, k])
            F = one + D * inverse
            P = wp.mat33d()
            if phase == EVALUATE:
                P = law_stress(F, p)
            else:
                S = wp.mat33d()
                for k in range(wp.static(node_count)):
                    S += wp.outer(along[k], gel.gradients[q, k])
                P = stress_rate(law_tangent(F, p), S * inverse)
            K = (P * wp.transpose(inverse)) * gel.weights[e, q]
            for k in range(wp.static(node_count)):
                f = K * gel.gradients[q, k]
                for axis in range(3):
                    total[k, axis] += f[axis]
        for k in range(wp.static(node_count)):
            add_vector(forces_out, gel.rows, gel.elements[e, k], b, total[k])

    return add_element


@cache
def force_kernel(law: Law, node_count: int) -> Any:
    """Build a law's kernel for elements of so many nodes.

    It launches over [contact_point_count + element_count * shares, environment_count].
    """
    add_element = element_function(law, node_count)

    @wp.kernel(enable_backward=False, module="unique")
    def forces(
        # Model:
        gel: BatchGel,
        surface: BatchSurface,
        settings: BatchContact,
        young: wp.array(dtype=wp.float64),
        rotations: wp.array(dtype=wp.mat33d),
        loads: wp.array2d(dtype=wp.float64),
        # Data in:
        phases: wp.array(dtype=wp.int32),
        frames: wp.array(dtype=wp.int32),
        tips: wp.array(dtype=wp.vec3d),
        displacements: wp.array2d(dtype=wp.float64),
        directions: wp.array2d(dtype=wp.float32),
        # Data in and out:
        touching: wp.array2d(dtype=wp.int32),
        # Data out:
        forces_out: wp.array2d(dtype=wp.float64),
        push_out: wp.array(dtype=wp.vec3d),
        gap_out: wp.array(dtype=wp.float64),
    ):
        i, b = wp.tid()
        phase = phases[b]
        if phase == EVALUATE or phase == SEARCH:
            if i == 0 and phase == EVALUATE and surface.tip_row >= 0:
                wp.atomic_add(forces_out, surface.tip_row, b, loads[frames[b], b])
            points = surface.areas.shape[1]
            contacts = surface.areas.shape[0] * points
            if i < contacts:
                add_contact(
                    i // points,
                    i % points,
                    b,
                    phase,
                    surface,
                    settings,
                    young,
                    tips,
                    rotations,
                    displacements,
                    directions,
                    touching,
                    forces_out,
                    push_out,
                    gap_out,
                )
            else:
                j = i - contacts
                add_element(
                    j // gel.shares,
                    j % gel.shares,
                    b,
                    phase,
                    gel,
                    displacements,
                    directions,
                    forces_out,
                )

    return forces
