"""Signed distance to a triangle surface on the device, in double precision.

Warp's tree works in single precision, so it only proposes a face. The exact distance to that face
and to those around it is computed from the double-precision vertices, and the search moves on
while a neighbour is nearer: near an edge, single precision may propose the wrong one of two faces.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import warp as wp

from sim.scene.indenter import MeshIndenter
from sim.scene.triangle_rays import DeviceSurface, on_device

_FACE = wp.constant(0)
_EDGE = wp.constant(1)
_VERTEX = wp.constant(4)
_MOVES_MAX = wp.constant(16)
# Of the surface's size: farther than this from its box, the distance to the box will do.
_FAR_SHARE = wp.constant(wp.float64(0.02))


@lru_cache(maxsize=8)
def uploaded_surface(indenter: MeshIndenter, device: str) -> tuple[Any, Any]:
    """Return a surface on a device, uploaded once, and its tree, which must live as long."""
    return on_device(indenter.surface, device)


@wp.struct
class Nearest:
    """The nearest point of a face.

    Attributes:
        squared: Squared distance [m^2].
        point: The nearest point [m].
        feature: Face, edge k or vertex k of the face.
    """

    squared: wp.float64
    point: wp.vec3d
    face: wp.int32
    feature: wp.int32


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
def nearest_on_surface(surface: DeviceSurface, p: wp.vec3d) -> Nearest:
    """Return the nearest point of a surface, from the face that the tree proposes."""
    scaled = wp.vec3f((p - surface.centre) * surface.per_size)
    query = wp.mesh_query_point_no_sign(surface.tree, scaled, wp.float32(1.0e6))
    best = nearest_on_face(surface, query.face if query.result else 0, p)
    for _ in range(_MOVES_MAX):
        here = best
        for k in range(3):
            other = nearest_on_face(surface, surface.neighbours[here.face, k], p)
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
def surface_distance(surface: DeviceSurface, p: wp.vec3d):
    """Return the distance [m], positive outside, and its gradient."""
    found = nearest_on_surface(surface, p)
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
    return distance, n


@wp.func
def nearby_distance(surface: DeviceSurface, p: wp.vec3d):
    """Return the same; far from the surface the distance to its box, which is less."""
    away = p - surface.centre
    beside = away - wp.max(-surface.half, wp.min(surface.half, away))
    distance = wp.length(beside)
    n = beside
    if distance * surface.per_size > _FAR_SHARE:
        n = beside / distance
    else:
        distance, n = surface_distance(surface, p)
    return distance, n
