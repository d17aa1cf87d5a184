"""Warp function of a batch's contact forces and their derivative along a direction.

The barrier is that of ``sim.contact``.
"""

# Device code: Warp compiles it, and Python type checkers do not speak its dialect.
# mypy: ignore-errors

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from sim.arrays import FloatArray
from sim.batch.nodal import add_vector, node_vector, unknown
from sim.batch.phases import EVALUATE
from sim.contact import barrier_curvature, barrier_slope
from sim.contact_body import Body, body_at, distance_curvature, signed_distance
from sim.device import Device
from sim.discretisation import Discretisation
from sim.indenter import Indenter, Plane
from sim.mesh_indenter import MeshIndenter
from sim.state import ContactOptions


@wp.struct
class BatchContact:
    """Numbers of the contact model that all environments share.

    Attributes:
        distance: d_hat [m].
        stiffness_factor: kappa over E d_hat.
        extension: Share of d_hat below which the barrier goes on as a parabola.
    """

    distance: wp.float64
    stiffness_factor: wp.float64
    extension: wp.float64


def batch_contact(options: ContactOptions, *, extension: float) -> Any:
    """Return the settings as the kernels take them."""
    settings = BatchContact()
    settings.distance = options.distance_m
    settings.stiffness_factor = options.stiffness_factor
    settings.extension = extension
    return settings


@wp.struct
class BatchSurface:
    """The surface that may be touched, and the indenter.

    Attributes:
        faces: Nodes, shape [face_count, face_node_count].
        rows: Unknown of every nodal component, -1 where it is fixed, shape [node_count, 3].
        rest: Nodes at rest [m].
        values: Shape functions, shape [face_point_count, face_node_count].
        areas: Rest area of every contact point [m^2], shape [face_count, face_point_count].
        body: The indenter, apart from its pose.
        tip_row: The unknown that is the indenter's lift [m] where it is pushed; -1 where its depth
            is given.
    """

    faces: wp.array2d(dtype=wp.int32)
    rows: wp.array2d(dtype=wp.int32)
    rest: wp.array(dtype=wp.vec3d)
    values: wp.array2d(dtype=wp.float64)
    areas: wp.array2d(dtype=wp.float64)
    body: Body
    tip_row: wp.int32


def batch_surface(
    pad: Discretisation,
    rows: Any,
    indenter: Indenter,
    *,
    kept: NDArray[np.bool_],
    tip_row: int,
    device: Device,
) -> Any:
    """Upload those faces of a pad that may be touched; ``rows`` is on the device already."""
    surface = BatchSurface()
    surface.faces = device.array(pad.faces[kept], wp.int32)
    surface.rows = rows
    surface.rest = device.array(pad.nodes, wp.vec3d)
    surface.values = device.array(pad.reference.face_values, wp.float64)
    areas = pad.face_areas[kept, None] * pad.reference.face_weights
    surface.areas = device.array(areas, wp.float64)
    surface.body = body_at(indenter, np.zeros(3), np.eye(3), device=device.name)
    surface.tip_row = tip_row
    return surface


@wp.func
def add_contact(
    f: wp.int32,
    q: wp.int32,
    b: wp.int32,
    phase: wp.int32,
    surface: BatchSurface,
    settings: BatchContact,
    young: wp.array(dtype=wp.float64),
    tips: wp.array(dtype=wp.vec3d),
    rotations: wp.array(dtype=wp.mat33d),
    displacements: wp.array2d(dtype=wp.float64),
    directions: wp.array2d(dtype=wp.float32),
    touching: wp.array2d(dtype=wp.int32),
    forces_out: wp.array2d(dtype=wp.float64),
    push_out: wp.array(dtype=wp.vec3d),
    gap_out: wp.array(dtype=wp.float64),
):
    """Add what one contact point of one environment contributes."""
    point = f * surface.values.shape[0] + q
    if phase != EVALUATE and touching[point, b] == 0:
        return
    x = wp.vec3d()
    for k in range(surface.faces.shape[1]):
        node = surface.faces[f, k]
        u = node_vector(displacements, surface.rows, node, b)
        x += (surface.rest[node] + u) * surface.values[q, k]
    body = surface.body
    lift = unknown(displacements, surface.tip_row, b)
    body.position = tips[b] + wp.vec3d(wp.float64(0.0), wp.float64(0.0), lift)
    body.rotation = rotations[b]
    gap, n = signed_distance(body, x)
    if phase == EVALUATE:
        touching[point, b] = wp.where(gap < settings.distance, 1, 0)
    if gap < settings.distance:
        s = gap / settings.distance
        scale = surface.areas[f, q] * settings.stiffness_factor * young[b]
        slope = scale * barrier_slope(s, settings.extension)
        v = wp.vec3d()
        if phase == EVALUATE:
            v = n * slope
            wp.atomic_add(push_out, b, v)
            wp.atomic_min(gap_out, b, gap)
        else:
            along = scale / settings.distance * barrier_curvature(s, settings.extension)
            sink = unknown(directions, surface.tip_row, b)
            d = wp.vec3d(wp.float64(0.0), wp.float64(0.0), -sink)
            for k in range(surface.faces.shape[1]):
                u = node_vector(directions, surface.rows, surface.faces[f, k], b)
                d += u * surface.values[q, k]
            v = n * (along * wp.dot(n, d)) + (distance_curvature(body, x) * d) * slope
        for k in range(surface.faces.shape[1]):
            add_vector(forces_out, surface.rows, surface.faces[f, k], b, v * surface.values[q, k])
        if surface.tip_row >= 0:
            wp.atomic_add(forces_out, surface.tip_row, b, -v[2])


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
