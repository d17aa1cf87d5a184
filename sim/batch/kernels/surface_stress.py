"""Cauchy stress on the surface of every environment of a batch (paper, Algorithm 1), in one launch.

It gives what ``sim.fields.stress`` gives for one press, and reads the displacements where they are.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import warp as wp

from sim.arrays import FloatArray
from sim.batch.kernels.element_forces import BatchGel, inverse_jacobian
from sim.batch.kernels.gathering import Numbering
from sim.device import Device, filled, on_host
from sim.fields.stress import SurfaceStress
from sim.material.elasticity import shape_gradients
from sim.material.laws.tangent import Law
from sim.mesh.discretisation import Discretisation
from sim.mesh.elements import ElementOrder, reference_element


@wp.struct
class StressedFaces:
    """The faces of a pad that are neither clamped nor on a plane of symmetry.

    Attributes:
        rows: Unknowns of every face, shape [3 * face_node_count, face_count].
        rest: Their nodes at rest [m], shape [face_node_count, face_count].
        parents: Tetrahedron behind each.
    """

    rows: wp.array2d(dtype=wp.int32)
    rest: wp.array2d(dtype=wp.vec3d)
    parents: wp.array(dtype=wp.int32)


# Where a face's results lie: normal, area, traction, its normal and its tangential part.
_AREA, _TRACTION, _NORMAL_STRESS, _TANGENTIAL, _COUNT = 3, 4, 7, 8, 11


class StressExtraction:
    """The launch with all that it needs, on the device.

    Args:
        gel: ``BatchGel`` of the environments.
        displacements: Over the unknowns [m], on the device; the first ``environment_count`` rows
            are read.
    """

    def __init__(
        self,
        pad: Discretisation,
        numbered: Numbering,
        law: Law,
        gel: Any,
        displacements: Any,
        *,
        environment_count: int,
        device: Device,
    ) -> None:
        faces = filled(
            StressedFaces,
            rows=device.array(numbered.of_nodes(pad.faces), wp.int32),
            rest=device.array(pad.nodes[pad.faces].transpose(1, 0, 2), wp.vec3d),
            parents=device.array(pad.face_parents, wp.int32),
        )
        self.face_count = len(pad.faces)
        # All in one array, which is one copy to the host.
        self._found = device.zeros((environment_count, _COUNT, self.face_count), wp.float64)
        self._launch = device.record(
            _stress_kernel(law, pad.reference.order),
            (environment_count, self.face_count),
            [gel, faces, displacements],
            [self._found],
        )

    def launch(self) -> None:
        """Find the stresses at the displacements as they are now."""
        self._launch.launch()

    def fetch(self) -> list[SurfaceStress]:
        """Return what the last launch found, an environment after the other."""
        return [_surface_stress(found) for found in np.array(on_host(self._found))]


def _surface_stress(found: FloatArray) -> SurfaceStress:
    """Name the results of an environment, shape [_COUNT, face_count]."""
    return SurfaceStress(
        normals=found[:_AREA].T,
        areas_m2=found[_AREA],
        traction_pa=found[_TRACTION:_NORMAL_STRESS].T,
        normal_pa=found[_NORMAL_STRESS],
        tangential_pa=found[_TANGENTIAL:].T,
    )


@cache
def _stress_kernel(law: Law, order: ElementOrder) -> Any:
    """Build the kernel; it launches over [environment_count, face_count]."""
    reference, law_stress = reference_element(order), law.stress
    gradients, node_count = shape_gradients(reference), reference.node_count
    point_weights = reference.weights.tolist()
    along, face_weights = reference.face_gradients.tolist(), reference.face_weights.tolist()
    face_node_count = reference.face_node_count
    Corners = wp.types.matrix(shape=(face_node_count, 3), dtype=wp.float64)

    @wp.func
    def element_stress(e: wp.int32, b: wp.int32, gel: BatchGel, displacements: Any) -> wp.mat33d:
        inverse = inverse_jacobian(e, gel)
        total = wp.mat33d()
        for q in range(wp.static(len(gradients))):
            D = wp.mat33d()
            for k in range(wp.static(node_count)):
                u0 = displacements[b, gel.rows[3 * k, e]]
                u1 = displacements[b, gel.rows[3 * k + 1, e]]
                u2 = displacements[b, gel.rows[3 * k + 2, e]]
                for j in range(3):
                    if wp.static(gradients[q][k][j] != 0.0):
                        g = wp.float64(wp.static(gradients[q][k][j]))
                        D[0, j] += u0 * g
                        D[1, j] += u1 * g
                        D[2, j] += u2 * g
            F = wp.identity(n=3, dtype=wp.float64) + D * inverse
            share = wp.float64(wp.static(point_weights[q])) / wp.determinant(F)
            total += (law_stress(F, gel.parameters[b]) * wp.transpose(F)) * share
        return total

    @wp.func
    def area_vector(i: wp.int32, b: wp.int32, faces: StressedFaces, displacements: Any) -> wp.vec3d:
        x = Corners()
        for k in range(wp.static(face_node_count)):
            for axis in range(3):
                x[k, axis] = faces.rest[k, i][axis] + displacements[b, faces.rows[3 * k + axis, i]]
        total = wp.vec3d()
        for p in range(wp.static(len(face_weights))):
            first = wp.vec3d()
            second = wp.vec3d()
            for k in range(wp.static(face_node_count)):
                node = wp.vec3d(x[k, 0], x[k, 1], x[k, 2])
                first += node * wp.float64(wp.static(along[p][k][0]))
                second += node * wp.float64(wp.static(along[p][k][1]))
            share = wp.float64(0.5) * wp.float64(wp.static(face_weights[p]))
            total += wp.cross(first, second) * share
        return total

    @wp.kernel(enable_backward=False, module="unique")
    def surface_stress(
        # Model:
        gel: BatchGel,
        faces: StressedFaces,
        # Data in:
        displacements: wp.array2d(dtype=wp.float64),
        # Data out:
        found_out: wp.array3d(dtype=wp.float64),
    ):
        b, i = wp.tid()
        vector = area_vector(i, b, faces, displacements)
        area = wp.length(vector)
        normal = vector / area
        traction = element_stress(faces.parents[i], b, gel, displacements) * normal
        normal_stress = wp.dot(traction, normal)
        tangential = traction - normal_stress * normal
        found_out[b, wp.static(_AREA), i] = area
        found_out[b, wp.static(_NORMAL_STRESS), i] = normal_stress
        for axis in range(3):
            found_out[b, axis, i] = normal[axis]
            found_out[b, wp.static(_TRACTION) + axis, i] = traction[axis]
            found_out[b, wp.static(_TANGENTIAL) + axis, i] = tangential[axis]

    return surface_stress
