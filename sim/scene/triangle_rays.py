"""Rays against a triangle surface, cast by Warp: what lies first above points of the plan."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from sim.arrays import FloatArray, IntArray
from sim.device import start_warp
from sim.scene.triangle_surface import TriangleSurface

start_warp()

# Rays start below a surface of size one about z = 0.
_RAY_START = -2.0


@wp.kernel(enable_backward=False, module="unique")
def _first_face(
    # Model:
    mesh: wp.uint64,
    start_z: wp.float32,
    # Data in:
    plan: wp.array(dtype=wp.vec2f),
    # Data out:
    face_out: wp.array(dtype=wp.int32),
):
    """Find the first face above every point of the plan, -1 where there is none."""
    i = wp.tid()
    start = wp.vec3f(plan[i][0], plan[i][1], start_z)
    hit = wp.mesh_query_ray(mesh, start, wp.vec3f(0.0, 0.0, 1.0), wp.float32(1.0e6))
    face_out[i] = -1
    if hit.result:
        face_out[i] = hit.face


def unit_tree(surface: TriangleSurface, device: str) -> tuple[Any, FloatArray, float]:
    """Return Warp's tree of a surface in unit size, its centre and its largest extent.

    Of unit size, so that single precision and Warp's own thresholds meet numbers near one.
    """
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    centre, size = 0.5 * (low + high), float((high - low).max())
    points: Any = wp.array((surface.vertices - centre) / size, dtype=wp.vec3f, device=device)
    corners: Any = wp.array(surface.faces.reshape(-1), dtype=wp.int32, device=device)
    return wp.Mesh(points=points, indices=corners), centre, size


def first_faces(surface: TriangleSurface, plan: FloatArray) -> IntArray:
    """Return the first face above points of the plan, -1 where there is none, shape [count].

    Args:
        surface: Any unit.
        plan: Shape [count, 2].
    """
    mesh, centre, scale = unit_tree(surface, "cpu")
    faces = wp.empty(len(plan), dtype=wp.int32, device="cpu")
    rays: Any = wp.array((plan - centre[:2]) / scale, dtype=wp.vec2f, device="cpu")
    wp.launch(
        _first_face,
        dim=len(plan),
        inputs=[mesh.id, _RAY_START, rays],
        outputs=[faces],
        device="cpu",
    )
    return np.asarray(faces.numpy())
