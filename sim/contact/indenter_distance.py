"""Signed distance to the rigid indenter on the device, in double precision.

Kernels are compiled for analytic bodies and, when the first mesh is pressed, for those: the others
carry nothing of its search.
"""

from dataclasses import fields
from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

from sim.device import Device, filled
from sim.scene.indenter import Cylinder, Indenter, IndenterSet, MeshIndenter, Sphere
from sim.scene.triangle_rays import (
    DeviceSurface,
    nearby_distance,
    on_device,
    surface_curvature,
    surface_distance,
)
from sim.scene.triangle_surface import TriangleSurface
from tacauchy_rig.core.arrays import FloatArray


@lru_cache(maxsize=64)
def uploaded_surface(indenter: MeshIndenter, device: str) -> tuple[Any, Any]:
    """Return a surface on a device, uploaded once, and its tree, which must live as long."""
    return on_device(indenter.surface, device, rounding_m=indenter.rounding_m)


# Of a body's least extent: how far its triangles are moved inwards at most, to round its edges.
_INSET_SHARE = 0.1
# Radius of a plate [m], which ends nowhere on a pad.
_PLATE_M = 1e9


@wp.struct
class Body:
    """An analytic indenter at its pose; local = rotation^T (x - position).

    It is a cylinder with a fillet, as wide as a plate or a ball's lower half; ``is_ball`` says
    whether it has the upper one.
    """

    is_ball: wp.bool
    radius: wp.float64
    fillet: wp.float64
    position: wp.vec3d
    rotation: wp.mat33d


@wp.struct
class MeshBody:
    """An indenter made of triangles at its pose."""

    surface: DeviceSurface
    position: wp.vec3d
    rotation: wp.mat33d


@wp.struct
class AnyBody:
    """The indenter of one environment at its pose, out of several that may be of any kind.

    The triangles of all lie in the arrays of ``mesh``.
    """

    which: wp.array(dtype=wp.int32)  # body of an environment, shape [environment_count]
    # of every body, shape [body_count]
    meshes: wp.array(dtype=wp.int32)  # 1 where it is made of triangles
    balls: wp.array(dtype=wp.int32)
    radii: wp.array(dtype=wp.float64)
    fillets: wp.array(dtype=wp.float64)
    trees: wp.array(dtype=wp.uint64)
    centres: wp.array(dtype=wp.vec3d)
    per_sizes: wp.array(dtype=wp.float64)
    halves: wp.array(dtype=wp.vec3d)
    first_faces: wp.array(dtype=wp.int32)
    roundings: wp.array(dtype=wp.float64)  # what lies so far from the triangles counts too [m]
    is_mesh: wp.bool
    analytic: Body
    mesh: MeshBody
    position: wp.vec3d
    rotation: wp.mat33d


@wp.struct
class Poses:
    """The indenter's pose in every environment, shape [environment_count] each."""

    tips: wp.array(dtype=wp.vec3d)  # in the pad's frame [m]
    rotations: wp.array(dtype=wp.mat33d)  # indenter frame to pad frame


@wp.func
def posed(body: Any, poses: Poses, b: wp.int32):
    """Return an indenter at the pose of an environment."""
    made = body
    made.position = poses.tips[b]
    made.rotation = poses.rotations[b]
    return made


@wp.func  # type: ignore[no-redef]
def posed(body: AnyBody, poses: Poses, b: wp.int32):  # noqa: F811 - Warp overloads by type
    """Return the indenter of an environment at its pose."""
    made = body
    k = body.which[b]
    made.position = poses.tips[b]
    made.rotation = poses.rotations[b]
    made.is_mesh = body.meshes[k] == 1
    made.analytic.is_ball = body.balls[k] == 1
    made.analytic.radius = body.radii[k]
    made.analytic.fillet = body.fillets[k]
    made.analytic.position = made.position
    made.analytic.rotation = made.rotation
    made.mesh.surface.tree = body.trees[k]
    made.mesh.surface.centre = body.centres[k]
    made.mesh.surface.per_size = body.per_sizes[k]
    made.mesh.surface.half = body.halves[k]
    made.mesh.surface.first_face = body.first_faces[k]
    made.mesh.surface.rounding = body.roundings[k]
    made.mesh.position = made.position
    made.mesh.rotation = made.rotation
    return made


def body_kind(indenter: Indenter | IndenterSet) -> Any:
    """Return the type of an indenter's description."""
    if isinstance(indenter, IndenterSet):
        return AnyBody
    return MeshBody if isinstance(indenter, MeshIndenter) else Body


def body_of(indenter: Indenter | IndenterSet, *, device: str = "cpu") -> Any:
    """Return the device's description of an indenter, without a pose; a mesh is uploaded once."""
    if isinstance(indenter, IndenterSet):
        return _bodies_of(indenter, device)
    if isinstance(indenter, MeshIndenter):
        return filled(MeshBody, surface=uploaded_surface(indenter, device)[0])
    if isinstance(indenter, Cylinder):
        return filled(Body, radius=indenter.radius_m, fillet=indenter.fillet_m)
    if isinstance(indenter, Sphere):
        return filled(Body, radius=indenter.radius_m, fillet=indenter.radius_m, is_ball=True)
    return filled(Body, radius=_PLATE_M)


def _bodies_of(indenters: IndenterSet, device: str) -> Any:
    """Return the description of several bodies, their triangles in common arrays."""
    on, count = Device(device), len(indenters.bodies)
    names = ("meshes", "balls", "first_faces", "radii", "fillets", "roundings", "per_sizes")
    table: dict[str, Any] = {name: np.zeros(count) for name in names}
    table |= {name: np.zeros((count, 3)) for name in ("centres", "halves")}
    table |= {"trees": np.zeros(count, dtype=np.uint64), "which": np.array(indenters.which)}
    pooled: dict[str, list[Any]] = {field.name: [] for field in fields(TriangleSurface)}
    vertex_count = face_count = slot_count = 0
    for k, indenter in enumerate(indenters.bodies):
        if not isinstance(indenter, MeshIndenter):
            own = body_of(indenter, device=device)
            table["balls"][k], table["radii"][k] = own.is_ball, own.radius
            table["fillets"][k] = max(own.fillet, min(indenters.rounding_m, own.radius))
            continue
        rounded = indenter.with_edges(
            min(indenters.rounding_m, _INSET_SHARE * float(indenter.size_m.min()))
        )
        surface, table["roundings"][k] = rounded.surface, rounded.rounding_m
        uploaded = uploaded_surface(rounded, device)[0]
        table["meshes"][k], table["trees"][k] = 1, uploaded.tree
        table["centres"][k], table["halves"][k] = uploaded.centre, uploaded.half
        table["per_sizes"][k], table["first_faces"][k] = uploaded.per_size, face_count
        shifts = {"faces": vertex_count, "neighbours": face_count, "ring_faces": face_count}
        for name, parts in pooled.items():
            values = getattr(surface, name)
            if name == "ring_starts":
                values = values[:-1] + slot_count
            parts.append(values + shifts.get(name, 0))
        vertex_count += len(surface.vertices)
        face_count += len(surface.faces)
        slot_count += len(surface.ring_faces)
    mesh = MeshBody()
    if face_count:
        pooled["ring_starts"].append(np.array([slot_count]))
        arrays = {name: np.concatenate(parts) for name, parts in pooled.items()}
        mesh.surface = on.tables(DeviceSurface, arrays)
    return on.tables(AnyBody, table, mesh=mesh)


def poses_at(tips: FloatArray, rotations: FloatArray, device: Device) -> Any:
    """Upload poses.

    Args:
        tips: In the pad's frame [m], shape [environment_count, 3].
        rotations: Indenter frame to pad frame, shape [environment_count, 3, 3].
    """
    return device.tables(Poses, {"tips": tips, "rotations": rotations})


@wp.func
def local_point(body: Any, x: wp.vec3d) -> wp.vec3d:
    """Return a point of the pad's frame in the indenter's frame [m]."""
    return wp.transpose(body.rotation) * (x - body.position)


@wp.func
def signed_distance(body: Body, x: wp.vec3d):
    """Return the gap [m], positive outside, and its gradient in the pad's frame."""
    zero = wp.float64(0.0)
    p = local_point(body, x)
    gap = -p[2]
    n = wp.vec3d(zero, zero, wp.float64(-1.0))
    if body.is_ball:
        c = p - wp.vec3d(zero, zero, body.radius)
        length = wp.max(wp.length(c), wp.float64(1.0e-30))
        gap = length - body.radius
        n = c / length
    else:
        r = wp.max(wp.sqrt(p[0] * p[0] + p[1] * p[1]), wp.float64(1.0e-30))
        side = r - (body.radius - body.fillet)
        below = body.fillet - p[2]
        outward = wp.vec3d(p[0] / r, p[1] / r, zero)
        if side > zero and below > zero:
            corner = wp.sqrt(side * side + below * below)
            gap = corner - body.fillet
            n = (outward * side + n * below) / corner
        elif below >= side:
            gap = below - body.fillet
        else:
            gap = side - body.fillet
            n = outward
    return gap, body.rotation * n


@wp.func  # type: ignore[no-redef]
def signed_distance(body: MeshBody, x: wp.vec3d):  # noqa: F811 - Warp overloads by type
    """Return the gap [m], positive outside, and its gradient in the pad's frame."""
    gap, n = surface_distance(body.surface, local_point(body, x))
    return gap, body.rotation * n


@wp.func
def nearby_gap(body: MeshBody, x: wp.vec3d):
    """Return the gap [m] and its gradient; far from the body too small a gap."""
    gap, n = nearby_distance(body.surface, local_point(body, x), body.surface.rounding)
    return gap, body.rotation * n


@wp.func  # type: ignore[no-redef]
def signed_distance(body: AnyBody, x: wp.vec3d):  # noqa: F811 - Warp overloads by type
    """Return the gap [m], positive outside, and its gradient in the pad's frame."""
    gap = wp.float64(0.0)
    n = wp.vec3d()
    if body.is_mesh:
        gap, n = signed_distance(body.mesh, x)
    else:
        gap, n = signed_distance(body.analytic, x)
    return gap, n


@wp.func  # type: ignore[no-redef]
def nearby_gap(body: AnyBody, x: wp.vec3d):  # noqa: F811 - Warp overloads by type
    """Return the gap [m] and its gradient; far from triangles too small a gap."""
    gap = wp.float64(0.0)
    n = wp.vec3d()
    if body.is_mesh:
        gap, n = nearby_gap(body.mesh, x)
    else:
        gap, n = signed_distance(body.analytic, x)
    return gap, n


@wp.func
def distance_curvature(body: Body, x: wp.vec3d) -> wp.mat33d:
    """Return the second derivative of the gap [1/m] in the pad's frame.

    A sharp rim's infinite curvature across the rim is left out: the gel's stiffness decides there.
    """
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    p = local_point(body, x)
    H = wp.mat33d()
    if body.is_ball:
        c = p - wp.vec3d(zero, zero, body.radius)
        length = wp.max(wp.length(c), wp.float64(1.0e-30))
        n = c / length
        H = (wp.identity(n=3, dtype=wp.float64) - wp.outer(n, n)) * (one / length)
    else:
        r = wp.max(wp.sqrt(p[0] * p[0] + p[1] * p[1]), wp.float64(1.0e-30))
        side = r - (body.radius - body.fillet)
        below = body.fillet - p[2]
        outward = wp.vec3d(p[0] / r, p[1] / r, zero)
        around = wp.vec3d(-outward[1], outward[0], zero)
        if side > zero and below > zero:
            corner = wp.max(wp.sqrt(side * side + below * below), wp.float64(1.0e-30))
            H = wp.outer(around, around) * (side / (corner * r))
            if body.fillet > zero:
                t = (outward * below + wp.vec3d(zero, zero, side)) / corner
                H += wp.outer(t, t) * (one / corner)
        elif side > below:
            H = wp.outer(around, around) * (one / r)
    return body.rotation * H * wp.transpose(body.rotation)


@wp.func  # type: ignore[no-redef]
def distance_curvature(body: MeshBody, x: wp.vec3d) -> wp.mat33d:  # noqa: F811
    """Return that of round edges; faces are flat, and sharp edges are left out as rims are."""
    found = wp.mat33d()
    if body.surface.rounding > wp.float64(0.0):
        found = surface_curvature(body.surface, local_point(body, x))
        found = body.rotation * found * wp.transpose(body.rotation)
    return found


@wp.func  # type: ignore[no-redef]
def distance_curvature(body: AnyBody, x: wp.vec3d) -> wp.mat33d:  # noqa: F811
    """Return the second derivative of the gap [1/m] in the pad's frame."""
    found = wp.mat33d()
    if body.is_mesh:
        found = distance_curvature(body.mesh, x)
    else:
        found = distance_curvature(body.analytic, x)
    return found
