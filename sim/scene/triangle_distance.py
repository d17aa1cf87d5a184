"""A triangle surface on a device, in double precision: distances, and heights over the plan.

Warp's tree of triangles works in single precision, so it only proposes a face. The exact distance
to that face and to those around it is computed from the double-precision vertices, and the search
moves on while a neighbour is nearer: near an edge, single precision may propose the wrong one of
two faces. What lies within ``rounding`` of the triangles belongs to a body, so that its edges are
round.
"""

from collections.abc import Callable
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

_FACE = wp.constant(0)
_EDGE = wp.constant(1)
_VERTEX = wp.constant(4)
_MOVES_MAX = wp.constant(16)
# How often a point rises towards a round body at most, and the distance at which it has met it [m].
_RISES_MAX = wp.constant(60)
_MET_M = wp.constant(wp.float64(1.0e-10))
# Of the surface's size: farther than this from it, no exact distance is needed.
_FAR_SHARE = wp.constant(wp.float64(0.01))
# Of the surface's size: rounding in the tree.
_SINGLE = wp.constant(wp.float64(4.0e-7))
# Faces of a leaf of the tree: four are found in three quarters of the time of one.
_LEAF = 4


@wp.struct
class DeviceSurface:
    """A ``TriangleSurface`` [m] and the tree that finds its faces; empty for analytic bodies."""

    # identifier of the ``wp.Mesh``, whose coordinates are (x - centre) * per_size: near one, where
    # single precision and Warp's own thresholds are at home
    tree: wp.uint64
    centre: wp.vec3d
    per_size: wp.float64
    half: wp.vec3d  # half the extents of its box
    rounding: wp.float64  # what lies so far from the triangles counts too [m]
    vertices: wp.array(dtype=wp.vec3d)
    faces: wp.array2d(dtype=wp.int32)
    neighbours: wp.array2d(dtype=wp.int32)
    ring_starts: wp.array(dtype=wp.int32)
    ring_faces: wp.array(dtype=wp.int32)
    face_normals: wp.array(dtype=wp.vec3d)
    vertex_normals: wp.array(dtype=wp.vec3d)


def on_device(surface: TriangleSurface, device: str, *, rounding_m: float = 0.0) -> tuple[Any, Any]:
    """Return a surface on a device, and its tree, which must live as long."""
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    centre, size = 0.5 * (low + high), float((high - low).max())
    points: Any = wp.array((surface.vertices - centre) / size, dtype=wp.vec3f, device=device)
    corners: Any = wp.array(surface.faces.reshape(-1), dtype=wp.int32, device=device)
    tree = wp.Mesh(points=points, indices=corners, bvh_leaf_size=_LEAF)
    placed = {
        "centre": wp.vec3d(*centre),
        "half": wp.vec3d(*(np.abs(surface.vertices - centre).max(axis=0))),
        "per_size": 1.0 / size,
        "rounding": rounding_m,
    }
    arrays = {field.name: getattr(surface, field.name) for field in fields(surface)}
    return Device(device).tables(DeviceSurface, arrays, tree=tree.id, **placed), tree


@wp.func
def _lowest_on_faces(surface: DeviceSurface, x: wp.float64, y: wp.float64) -> wp.float64:
    """Return the lowest height of triangles over a point of the plan, ``BESIDE`` beside them.

    A ray in single precision finds the face; the height on it is kept within the face.
    """
    start = wp.vec3f((wp.vec3d(x, y, wp.float64(0.0)) - surface.centre) * surface.per_size)
    start[2] = _RAY_START
    hit = wp.mesh_query_ray(surface.tree, start, wp.vec3f(0.0, 0.0, 1.0), wp.float32(1.0e6))
    if not hit.result:
        return BESIDE
    face = hit.face
    a = surface.vertices[surface.faces[face, 0]]
    b = surface.vertices[surface.faces[face, 1]]
    c, n = surface.vertices[surface.faces[face, 2]], surface.face_normals[face]
    low, high = wp.min(wp.min(a[2], b[2]), c[2]), wp.max(wp.max(a[2], b[2]), c[2])
    # A wall that a ray grazes has no height of its own there: its lower end counts.
    if wp.abs(n[2]) < _UPRIGHT:
        return low
    return wp.clamp(a[2] + (n[0] * (a[0] - x) + n[1] * (a[1] - y)) / n[2], low, high)


@wp.struct
class Nearest:
    """The nearest point of a face."""

    squared: wp.float64  # squared distance [m^2]
    point: wp.vec3d  # the nearest point [m]
    face: wp.int32
    feature: wp.int32  # face, edge k or vertex k of the face


@wp.func
def nearest_on_face(surface: DeviceSurface, face: wp.int32, p: wp.vec3d) -> Nearest:
    """Return the point of a face nearest to ``p``; a face without area counts by its edges."""
    zero, one = wp.float64(0.0), wp.float64(1.0)
    found = Nearest()
    found.face = face
    found.squared = wp.float64(1.0e300)
    n = surface.face_normals[face]
    above = bool(wp.dot(n, n) > zero)
    for k in range(3):
        a = surface.vertices[surface.faces[face, k]]
        edge = surface.vertices[surface.faces[face, (k + 1) % 3]] - a
        away = p - a
        if wp.dot(wp.cross(edge, away), n) < zero:
            above = bool(False)  # noqa: UP018 - a variable to Warp, not a constant
        t = wp.clamp(wp.dot(away, edge) / wp.dot(edge, edge), zero, one)
        left = away - edge * t
        squared = wp.dot(left, left)
        if squared < found.squared:
            found.squared = squared
            found.point = a + edge * t
            found.feature = _EDGE + k
            if t == zero:
                found.feature = _VERTEX + k
            if t == one:
                found.feature = _VERTEX + (k + 1) % 3
    if above:
        height = wp.dot(p - surface.vertices[surface.faces[face, 0]], n)
        found.squared = height * height
        found.point = p - n * height
        found.feature = _FACE
    return found


@wp.func
def _nearest_from(surface: DeviceSurface, face: wp.int32, p: wp.vec3d) -> Nearest:
    """Return the nearest point of a surface, from a face that is near it."""
    # Over the inside of a face that a point is in front of, only what rises there may be nearer.
    best = nearest_on_face(surface, face, p)
    for _ in range(_MOVES_MAX):
        here = best
        n = surface.face_normals[here.face]
        behind = wp.dot(p - surface.vertices[surface.faces[here.face, 0]], n) <= wp.float64(0.0)
        for k in range(3):
            across = surface.neighbours[here.face, k]
            edge = surface.vertices[surface.faces[here.face, (k + 1) % 3]]
            edge -= surface.vertices[surface.faces[here.face, k]]
            rises = wp.dot(surface.face_normals[across], wp.cross(edge, n)) < -_MET_M
            if behind or rises or here.feature == _EDGE + k:
                other = nearest_on_face(surface, across, p)
                if other.squared < best.squared:
                    best = other
        if here.feature >= _VERTEX:
            vertex = surface.faces[here.face, here.feature - _VERTEX]
            for slot in range(surface.ring_starts[vertex], surface.ring_starts[vertex + 1]):
                other = nearest_on_face(surface, surface.ring_faces[slot], p)
                if other.squared < best.squared:
                    best = other
        if best.face == here.face:
            break
    return best


@wp.func
def _signed(surface: DeviceSurface, p: wp.vec3d, found: Nearest):
    """Return the distance to the nearest point [m], positive outside, and its gradient."""
    n = surface.face_normals[found.face]
    distance = wp.dot(p - surface.vertices[surface.faces[found.face, 0]], n)
    if found.feature != _FACE:
        if found.feature >= _VERTEX:
            n = surface.vertex_normals[surface.faces[found.face, found.feature - _VERTEX]]
        else:
            n = wp.normalize(
                n + surface.face_normals[surface.neighbours[found.face, found.feature - _EDGE]]
            )
        left = p - found.point
        distance = wp.sqrt(found.squared)
        if wp.dot(left, n) < wp.float64(0.0):
            distance = -distance
        if found.squared > wp.float64(1.0e-30):
            n = left / distance
    return distance - surface.rounding, n


@wp.func
def nearby_distance(surface: DeviceSurface, p: wp.vec3d, reach: wp.float64, near: wp.int32):
    """Return the distance [m], positive outside, its gradient, and the nearest face, -1 if far.

    Outside and beyond ``reach`` [m] it may be too small, but not below that.
    Where no face is near, a ray down that meets none tells that the point is outside.
    A face that may be near, if not -1, shortens the search and changes nothing else.
    """
    away = p - surface.centre
    beside = away - wp.max(-surface.half, wp.min(surface.half, away))
    distance, n, best = wp.length(beside) - surface.rounding, beside, Nearest()
    far = wp.max(_FAR_SHARE / surface.per_size, reach)
    best.face = -1
    if distance > far:
        n = wp.normalize(beside)
    else:
        within = far + surface.rounding
        if near >= 0:
            within = wp.min(within, wp.sqrt(nearest_on_face(surface, near, p).squared))
        scaled = wp.vec3f(away * surface.per_size)
        most = wp.float32(within * surface.per_size + _SINGLE)
        query = wp.mesh_query_point_no_sign(surface.tree, scaled, most)
        if query.result:
            best = _nearest_from(surface, query.face, p)
        else:
            down = wp.vec3f(0.0, 0.0, -1.0)
            distance = far
            if wp.mesh_query_ray(surface.tree, scaled, down, wp.float32(1.0e6)).result:
                query = wp.mesh_query_point_no_sign(surface.tree, scaled, wp.float32(1.0e6))
                best = _nearest_from(surface, query.face, p)
        if best.face >= 0:
            distance, n = _signed(surface, p, best)
    return distance, n, best.face


@wp.func
def lowest_height(surface: DeviceSurface, x: wp.float64, y: wp.float64) -> wp.float64:
    """Return the lowest height of a body over a point of the plan, ``BESIDE`` beside it.

    A round one is met from below: along tangents, which pass through no convex body; where they
    would, by the distance itself.
    """
    zero = wp.float64(0.0)
    if surface.rounding == zero:
        return _lowest_on_faces(surface, x, y)
    reach = surface.half + wp.vec3d(surface.rounding, surface.rounding, surface.rounding)
    away = wp.vec3d(x, y, zero) - surface.centre
    if wp.abs(away[0]) > reach[0] or wp.abs(away[1]) > reach[1]:
        return BESIDE
    at = wp.vec3d(x, y, surface.centre[2] - reach[2])
    high, safe, distance, face = surface.centre[2] + reach[2], at[2], zero, wp.int32(-1)
    for _ in range(_RISES_MAX):
        distance, n, face = nearby_distance(surface, at, BESIDE, face)
        if wp.abs(distance) < _MET_M or at[2] > high:
            break
        if distance < zero:
            at[2] = safe
        else:
            safe = at[2] + distance
            at[2] += distance / wp.max(-n[2], _UPRIGHT)
    return wp.where(distance < _MET_M, at[2], BESIDE)


@wp.func
def hit_below(surface: DeviceSurface, p: wp.vec3d, down: wp.vec3d) -> wp.float64:
    """Return how far down a unit direction a point within triangles leaves them; zero outside [m].

    In single precision, of the surface's size.
    """
    start = wp.vec3f((p - surface.centre) * surface.per_size)
    hit = wp.mesh_query_ray(surface.tree, start, wp.vec3f(down), wp.float32(1.0e6))
    found = wp.float64(0.0)
    if hit.result and wp.dot(surface.face_normals[hit.face], down) > found:
        found = wp.float64(hit.t) / surface.per_size
    return found


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


def underside(
    surface: TriangleSurface, *, rounding_m: float = 0.0
) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Return the lowest height by x and y, inf beside the surface, which is uploaded once."""
    device = Device("cpu")
    uploaded = on_device(surface, device.name, rounding_m=rounding_m)

    def lowest(x: FloatArray, y: FloatArray) -> FloatArray:
        x, y = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        plan = np.column_stack([x.reshape(-1), y.reshape(-1)])
        heights = device.empty((len(plan),), wp.float64)
        inputs = [uploaded[0], device.array(plan, wp.vec2d)]
        device.launch(_lowest_heights, (len(plan),), inputs, [heights])
        found: FloatArray = heights.numpy()
        return np.where(found >= float(BESIDE), np.inf, found).reshape(x.shape)

    return lowest
