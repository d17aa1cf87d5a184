"""Warp kernel of the contact forces alone, summed at the nodes as they are found."""

# Device code: Warp compiles it, and Python type checkers do not speak its dialect.
# mypy: ignore-errors

from __future__ import annotations

import warp as wp

from sim.contact.barrier import ContactSettings, barrier_slope, surface_point
from sim.contact.indenter_distance import Body, signed_distance


@wp.kernel(enable_backward=False)
def push(
    # Model:
    faces: wp.array2d(dtype=wp.int32),
    face_values: wp.array2d(dtype=wp.float64),
    areas: wp.array2d(dtype=wp.float64),
    settings: ContactSettings,
    body: Body,
    # Data in:
    positions: wp.array(dtype=wp.vec3d),
    # Data out:
    nodes_out: wp.array(dtype=wp.vec3d),
    push_out: wp.array(dtype=wp.vec3d),
    gap_out: wp.array(dtype=wp.float64),
):
    """Add the contact energy's gradient [N] to the nodes; launches over [face_count, point_count].

    Its sum is the force on the indenter; the smallest gap is that of the points that touch [m].
    """
    f, q = wp.tid()
    distance, n = signed_distance(body, surface_point(faces, face_values, positions, f, q))
    if distance < settings.distance:
        scale = areas[f, q] * settings.stiffness / settings.distance
        v = n * (scale * barrier_slope(distance / settings.distance, settings.extension))
        for k in range(faces.shape[1]):
            wp.atomic_add(nodes_out, faces[f, k], v * face_values[q, k])
        wp.atomic_add(push_out, 0, v)
        wp.atomic_min(gap_out, 0, distance)
