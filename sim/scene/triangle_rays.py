"""A triangle surface on a device, and rays against it: how low it is over points of the plan."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import warp as wp

from sim.device import Device, start_warp
from sim.scene.triangle_surface import TriangleSurface
from tacauchy_rig.core.arrays import FloatArray

start_warp()

# Rays start below a surface of size one about z = 0.
_RAY_START = wp.constant(wp.float32(-2.0))
# A face that rises more steeply than by this z of its unit normal is a wall.
_UPRIGHT = wp.constant(wp.float64(1.0e-3))
# In place of infinity, which is not the same number on all devices.
BESIDE = wp.constant(wp.float64(1.0e9))


@wp.struct
class DeviceSurface:
    """A ``TriangleSurface`` [m] and the tree that finds its faces; empty for analytic bodies."""

    # identifier of the ``wp.Mesh``, whose coordinates are (x - centre) * per_size: near one, where
    # single precision and Warp's own thresholds are at home
    tree: wp.uint64
    centre: wp.vec3d
    per_size: wp.float64
    half: wp.vec3d  # half the extents of its box
    first_face: wp.int32  # of the tree's faces, where the arrays hold several surfaces
    vertices: wp.array(dtype=wp.vec3d)
    faces: wp.array2d(dtype=wp.int32)
    neighbours: wp.array2d(dtype=wp.int32)
    ring_starts: wp.array(dtype=wp.int32)
    ring_faces: wp.array(dtype=wp.int32)
    face_normals: wp.array(dtype=wp.vec3d)
    vertex_normals: wp.array(dtype=wp.vec3d)


def on_device(surface: TriangleSurface, device: str) -> tuple[Any, Any]:
    """Return a surface on a device, and its tree, which must live as long."""
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    centre, size = 0.5 * (low + high), float((high - low).max())
    points: Any = wp.array((surface.vertices - centre) / size, dtype=wp.vec3f, device=device)
    corners: Any = wp.array(surface.faces.reshape(-1), dtype=wp.int32, device=device)
    tree = wp.Mesh(points=points, indices=corners)
    placed = {
        "centre": wp.vec3d(*centre),
        "half": wp.vec3d(*(np.abs(surface.vertices - centre).max(axis=0))),
        "per_size": 1.0 / size,
    }
    arrays = {field.name: getattr(surface, field.name) for field in fields(surface)}
    return Device(device).tables(DeviceSurface, arrays, tree=tree.id, **placed), tree


@wp.func
def lowest_height(surface: DeviceSurface, x: wp.float64, y: wp.float64) -> wp.float64:
    """Return the lowest height of a surface over a point of the plan, ``BESIDE`` beside it.

    A ray in single precision finds the face; the height on it is kept within the face.
    """
    start = wp.vec3f((wp.vec3d(x, y, wp.float64(0.0)) - surface.centre) * surface.per_size)
    start[2] = _RAY_START
    hit = wp.mesh_query_ray(surface.tree, start, wp.vec3f(0.0, 0.0, 1.0), wp.float32(1.0e6))
    if not hit.result:
        return BESIDE
    face = surface.first_face + hit.face
    a = surface.vertices[surface.faces[face, 0]]
    b = surface.vertices[surface.faces[face, 1]]
    c, n = surface.vertices[surface.faces[face, 2]], surface.face_normals[face]
    low, high = wp.min(wp.min(a[2], b[2]), c[2]), wp.max(wp.max(a[2], b[2]), c[2])
    # A wall that a ray grazes has no height of its own there: its lower end counts.
    if wp.abs(n[2]) < _UPRIGHT:
        return low
    return wp.clamp(a[2] + (n[0] * (a[0] - x) + n[1] * (a[1] - y)) / n[2], low, high)


@wp.kernel(enable_backward=False, module="unique")
def _lowest_heights(
    surface: DeviceSurface,
    # Data in:
    plan: wp.array(dtype=wp.vec2d),
    # Data out:
    height_out: wp.array(dtype=wp.float64),
):
    """Find the lowest height over every point of the plan."""
    i = wp.tid()
    height_out[i] = lowest_height(surface, plan[i][0], plan[i][1])


def underside(surface: TriangleSurface, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the lowest height over points of the plan, of one shape together; inf beside it."""
    x, y = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
    plan = np.column_stack([x.reshape(-1), y.reshape(-1)])
    device = Device("cpu")
    uploaded, _tree = on_device(surface, device.name)
    heights = device.empty((len(plan),), wp.float64)
    inputs = [uploaded, device.array(plan, wp.vec2d)]
    device.launch(_lowest_heights, (len(plan),), inputs, [heights])
    found: FloatArray = heights.numpy()
    return np.where(found >= float(BESIDE), np.inf, found).reshape(x.shape)
