"""Height of a triangle surface's underside, by rays cast upwards from below it."""

# Device code: Warp compiles it, and Python type checkers do not speak its dialect.
# mypy: ignore-errors

from __future__ import annotations

import numpy as np
import warp as wp

from sim.arrays import FloatArray
from sim.scene.triangle_surface import TriangleSurface
from sim.warp_start import start_warp

start_warp()

_START = -2.0
_UPRIGHT = 1.0e-3


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


def underside(surface: TriangleSurface, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the lowest height of a surface over points of the plan, inf beside it.

    Rays in single precision find the face; the height on it is computed in double precision.

    Args:
        surface: Any unit.
        x: Any shape.
        y: Shape that broadcasts with that of ``x``.
    """
    x, y = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
    plan = np.column_stack([x.reshape(-1), y.reshape(-1)])
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    # Unit size, so that single precision and Warp's own thresholds meet numbers near one.
    centre, scale = 0.5 * (low + high), float((high - low).max())
    mesh = wp.Mesh(
        points=wp.array((surface.vertices - centre) / scale, dtype=wp.vec3f, device="cpu"),
        indices=wp.array(surface.faces.reshape(-1), dtype=wp.int32, device="cpu"),
    )
    faces = wp.empty(len(plan), dtype=wp.int32, device="cpu")
    rays = wp.array((plan - centre[:2]) / scale, dtype=wp.vec2f, device="cpu")
    wp.launch(
        _first_face, dim=len(plan), inputs=[mesh.id, -2.0, rays], outputs=[faces], device="cpu"
    )
    found = faces.numpy()
    heights = np.full(len(plan), np.inf)
    hit = found >= 0
    heights[hit] = _height_on(surface, found[hit], plan[hit])
    return heights.reshape(x.shape)


def _height_on(surface: TriangleSurface, faces: np.ndarray, plan: FloatArray) -> FloatArray:
    """Return the height of the faces' planes at points, kept within the faces."""
    corners = surface.vertices[surface.faces[faces]]
    normals = surface.face_normals[faces]
    rise = np.einsum("ij,ij->i", normals[:, :2], corners[:, 0, :2] - plan)
    # A wall that a ray grazes has no height of its own there: its lower end counts.
    upright = np.abs(normals[:, 2]) < _UPRIGHT
    height = corners[:, 0, 2] + rise / np.where(upright, 1.0, normals[:, 2])
    height = np.where(upright, -np.inf, height)
    return np.clip(height, corners[..., 2].min(axis=1), corners[..., 2].max(axis=1))
