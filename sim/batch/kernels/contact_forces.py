"""Warp functions of a batch's contact forces and their change along a direction.

The barrier is that of ``sim.contact.barrier``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from sim.arrays import FloatArray
from sim.batch.kernels.gathering import Numbering
from sim.contact.barrier import barrier_curvature, barrier_slope
from sim.contact.indenter_distance import Body, body_at, distance_curvature, signed_distance
from sim.contact.state import ContactOptions
from sim.device import Device, filled
from sim.mesh.discretisation import Discretisation
from sim.scene.indenter import Indenter, MeshIndenter, Plane


@wp.struct
class BatchSurface:
    """The surface that may be touched, and the indenter.

    Attributes:
        rows: Unknowns of every face, shape [3 * face_node_count, face_count].
        rest: Their nodes at rest [m], shape [face_node_count, face_count].
        values: Shape functions, shape [face_point_count, face_node_count].
        rough_values: The same in float32.
        areas: Rest area of every contact point [m^2], shape [face_point_count, face_count].
        body: The indenter, apart from its pose.
        rotations: Of the indenter in every environment.
        young: E of the gel in every environment [Pa].
        distance: d_hat [m].
        stiffness_factor: kappa over E d_hat.
        extension: Share of d_hat below which the barrier goes on as a parabola.
    """

    rows: wp.array2d(dtype=wp.int32)
    rest: wp.array2d(dtype=wp.vec3d)
    values: wp.array2d(dtype=wp.float64)
    rough_values: wp.array2d(dtype=wp.float32)
    areas: wp.array2d(dtype=wp.float64)
    body: Body
    rotations: wp.array(dtype=wp.mat33d)
    young: wp.array(dtype=wp.float64)
    distance: wp.float64
    stiffness_factor: wp.float64
    extension: wp.float64


def batch_surface(
    pad: Discretisation,
    numbered: Numbering,
    indenter: Indenter,
    *,
    rotations: FloatArray,
    young_pa: Sequence[float],
    kept: NDArray[np.bool_],
    contact: ContactOptions,
    extension: float,
    device: Device,
) -> Any:
    """Upload those faces of a pad that may be touched, and what touches them.

    Args:
        rotations: Of the indenter in every environment, shape [environment_count, 3, 3].
        young_pa: E of every environment's gel [Pa].
        kept: Which faces.
    """
    faces, values = pad.faces[kept], pad.reference.face_values
    areas = pad.reference.face_weights[:, None] * pad.face_areas[kept]
    return filled(
        BatchSurface,
        rows=device.array(numbered.of_nodes(faces), wp.int32),
        rest=device.array(pad.nodes[faces].transpose(1, 0, 2), wp.vec3d),
        values=device.array(values, wp.float64),
        rough_values=device.array(values, wp.float32),
        areas=device.array(areas, wp.float64),
        body=body_at(indenter, np.zeros(3), np.eye(3), device=device.name),
        rotations=device.array(rotations, wp.mat33d),
        young=device.array(young_pa, wp.float64),
        distance=contact.distance_m,
        stiffness_factor=contact.stiffness_factor,
        extension=extension,
    )


@wp.struct
class ContactPoints:
    """What the contact points of all environments have found.

    Attributes:
        touching: 1 within d_hat at the last evaluation, shape [environment_count, point_count].
        forces: Unbalanced, or their change along a direction [N]; the same shape.
        stiffness: Their derivative where they touch [N/m]; the same shape.
        face_forces: What faces contribute to their nodes [N], shape [environment_count,
            3 * face_node_count * face_count].
    """

    touching: wp.array2d(dtype=wp.int32)
    forces: wp.array2d(dtype=wp.vec3d)
    stiffness: wp.array2d(dtype=wp.mat33f)
    face_forces: wp.array2d(dtype=wp.float64)


def contact_points(environment_count: int, surface: Any, device: Device) -> Any:
    """Return the arrays for a surface."""
    point_count, face_count = surface.areas.size, surface.areas.shape[1]
    shape, nodes = (environment_count, point_count), 3 * surface.rest.shape[0] * face_count
    return filled(
        ContactPoints,
        touching=device.zeros(shape, wp.int32),
        forces=device.zeros(shape, wp.vec3d),
        stiffness=device.zeros(shape, wp.mat33f),
        face_forces=device.zeros((environment_count, nodes), wp.float64),
    )


@wp.func
def contact_force(
    point: wp.int32,
    b: wp.int32,
    tip: wp.vec3d,
    surface: BatchSurface,
    displacements: Any,
):
    """Return the unbalanced force of one contact point [N], its derivative [N/m], its gap [m]."""
    f = point % surface.areas.shape[1]
    q = point // surface.areas.shape[1]
    x = wp.vec3d()
    for k in range(surface.values.shape[1]):
        u = wp.vec3d(
            displacements[surface.rows[3 * k, f]],
            displacements[surface.rows[3 * k + 1, f]],
            displacements[surface.rows[3 * k + 2, f]],
        )
        x += (surface.rest[k, f] + u) * surface.values[q, k]
    body = surface.body
    body.position = tip
    body.rotation = surface.rotations[b]
    gap, n = signed_distance(body, x)
    v = wp.vec3d()
    stiffness = wp.mat33f()
    if gap < surface.distance:
        s = gap / surface.distance
        scale = surface.areas[q, f] * surface.stiffness_factor * surface.young[b]
        slope = scale * barrier_slope(s, surface.extension)
        along = scale / surface.distance * barrier_curvature(s, surface.extension)
        v = n * slope
        stiffness = wp.mat33f(wp.outer(n, n) * along + distance_curvature(body, x) * slope)
    return v, stiffness, gap


@wp.func
def contact_rate(
    point: wp.int32,
    sink: wp.float32,
    stiffness: wp.mat33f,
    surface: BatchSurface,
    directions: Any,
) -> wp.vec3d:
    """Return its change along a direction, in which the indenter rises by ``sink``."""
    f = point % surface.areas.shape[1]
    q = point // surface.areas.shape[1]
    d = wp.vec3f(0.0, 0.0, -sink)
    for k in range(surface.values.shape[1]):
        u = wp.vec3f(
            directions[surface.rows[3 * k, f]],
            directions[surface.rows[3 * k + 1, f]],
            directions[surface.rows[3 * k + 2, f]],
        )
        d += u * surface.rough_values[q, k]
    return wp.vec3d(stiffness * d)


@wp.func
def spread_contact(i: wp.int32, b: wp.int32, surface: BatchSurface, contact: ContactPoints):
    """Sum what the points of a face contribute to one of its nodes."""
    face_count = surface.areas.shape[1]
    f = i % face_count
    k = i // face_count
    v = wp.vec3d()
    for q in range(surface.values.shape[0]):
        v += contact.forces[b, q * face_count + f] * surface.values[q, k]
    for axis in range(3):
        contact.face_forces[b, (3 * k + axis) * face_count + f] = v[axis]


def touchable(pad: Discretisation, indenter: Indenter, centres_m: FloatArray) -> NDArray[np.bool_]:
    """Return which faces an upright indenter may reach: half the pad's height beside it at most.

    Args:
        centres_m: Where it comes down, x and y [m], shape [environment_count, 2].
    """
    if isinstance(indenter, Plane | MeshIndenter):
        return np.ones(len(pad.faces), dtype=np.bool_)
    corners = pad.nodes[pad.faces[:, :3], :2]
    away = np.linalg.norm(corners[:, :, None] - centres_m, axis=-1).min(axis=(1, 2))
    return np.asarray(away <= indenter.radius_m + 0.5 * pad.nodes[:, 2].max())
