"""Warp kernel that projects the elements' stress onto the surface (paper, Algorithm 1, Eq. 5-7)."""

from functools import cache
from typing import Any

import warp as wp

from sim.device import constant_table
from sim.mesh.elements import ElementOrder, reference_element


@cache
def projection_kernel(order: ElementOrder) -> Any:
    """Build the kernel; it launches over [environment_count, face_count]."""
    reference = reference_element(order)
    along = constant_table(reference.face_gradients)
    shares = constant_table(0.5 * reference.face_weights)
    point_count, node_count = len(reference.face_weights), reference.face_node_count

    @wp.kernel(enable_backward=False, module="unique")
    def project(
        # Model:
        faces: wp.array2d(dtype=wp.int32),
        parents: wp.array(dtype=wp.int32),
        weights: wp.array(dtype=wp.float64),
        # Data in:
        stress: wp.array3d(dtype=wp.mat33d),
        positions: wp.array2d(dtype=wp.vec3d),
        # Data out:
        found_out: wp.array3d(dtype=wp.float64),
    ):
        b, f = wp.tid()
        vector = wp.vec3d()
        for p in range(wp.static(point_count)):
            first = wp.vec3d()
            second = wp.vec3d()
            for k in range(wp.static(node_count)):
                x = positions[b, faces[f, k]]
                first += x * along(2 * (p * wp.static(node_count) + k))
                second += x * along(2 * (p * wp.static(node_count) + k) + 1)
            vector += wp.cross(first, second) * shares(p)
        area = wp.length(vector)
        normal = vector / area
        sigma = wp.mat33d()
        for q in range(weights.shape[0]):
            sigma += stress[b, parents[f], q] * weights[q]
        traction = sigma * normal
        across = wp.dot(traction, normal)
        tangential = traction - normal * across
        found_out[b, f, 3] = area
        found_out[b, f, 7] = across
        for axis in range(3):
            found_out[b, f, axis] = normal[axis]
            found_out[b, f, 4 + axis] = traction[axis]
            found_out[b, f, 8 + axis] = tangential[axis]

    return project
