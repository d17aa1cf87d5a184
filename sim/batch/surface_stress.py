"""Cauchy stress on the surface of every environment of a batch (paper, Algorithm 1), in one launch.

It gives what ``sim.stress`` gives for one press, and reads the displacements where they are.
"""

# Device code: Warp compiles it, and Python type checkers do not speak its dialect.
# mypy: ignore-errors

from __future__ import annotations

from functools import cache
from typing import Any

import warp as wp

from sim.batch.element_forces import BatchGel, inverse_jacobian
from sim.batch.numbering import Numbering
from sim.device import Device, on_host
from sim.discretisation import Discretisation
from sim.element_gradient import shape_gradients
from sim.elements import ElementOrder, reference_element
from sim.laws.tangent import Law
from sim.stress import SurfaceStress
from sim.warp_start import start_warp

start_warp()


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


@wp.struct
class FaceStresses:
    """What is found, each of shape [environment_count, face_count].

    Attributes:
        normals: Outward unit normals of the deformed faces.
        areas: Of the deformed faces [m^2].
        tractions: Stress times normal [Pa].
        normal_stresses: Their parts along the normal [Pa].
        tangential: What is left of them [Pa].
    """

    normals: wp.array2d(dtype=wp.vec3d)
    areas: wp.array2d(dtype=wp.float64)
    tractions: wp.array2d(dtype=wp.vec3d)
    normal_stresses: wp.array2d(dtype=wp.float64)
    tangential: wp.array2d(dtype=wp.vec3d)


class StressExtraction:
    """All that the launch needs, on the device.

    Args:
        gel: ``BatchGel`` of the environments.
        environment_count: How many of them are read.
    """

    def __init__(
        self,
        pad: Discretisation,
        numbered: Numbering,
        law: Law,
        gel: Any,
        *,
        environment_count: int,
        device: Device,
    ) -> None:
        self._gel, self._device = gel, device
        self._kernel = _stress_kernel(law, pad.reference.order)
        self._faces = StressedFaces()
        self._faces.rows = device.array(numbered.of_nodes(pad.faces), wp.int32)
        self._faces.rest = device.array(pad.nodes[pad.faces].transpose(1, 0, 2), wp.vec3d)
        self._faces.parents = device.array(pad.face_parents, wp.int32)
        self._shape = (environment_count, len(pad.faces))
        self._found = FaceStresses()
        for name in ("normals", "tractions", "tangential"):
            setattr(self._found, name, device.zeros(self._shape, wp.vec3d))
        for name in ("areas", "normal_stresses"):
            setattr(self._found, name, device.zeros(self._shape, wp.float64))

    @property
    def face_count(self) -> int:
        """Faces of every environment."""
        return self._shape[1]

    def launch(self, displacements: Any) -> None:
        """Find the stresses at displacements [m] on the device, environment by environment."""
        self._device.launch(
            self._kernel, self._shape, [self._gel, self._faces, displacements], [self._found]
        )

    def fetch(self) -> list[SurfaceStress]:
        """Return what the last launch found, an environment after the other."""
        found = self._found
        columns = {
            "normals": found.normals,
            "areas_m2": found.areas,
            "traction_pa": found.tractions,
            "normal_pa": found.normal_stresses,
            "tangential_pa": found.tangential,
        }
        hosted = {name: on_host(array) for name, array in columns.items()}
        return [
            SurfaceStress(**{name: values[b].copy() for name, values in hosted.items()})
            for b in range(self._shape[0])
        ]


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
        found: FaceStresses,
    ):
        b, i = wp.tid()
        vector = area_vector(i, b, faces, displacements)
        area = wp.length(vector)
        normal = vector / area
        traction = element_stress(faces.parents[i], b, gel, displacements) * normal
        normal_stress = wp.dot(traction, normal)
        found.normals[b, i] = normal
        found.areas[b, i] = area
        found.tractions[b, i] = traction
        found.normal_stresses[b, i] = normal_stress
        found.tangential[b, i] = traction - normal_stress * normal

    return surface_stress
