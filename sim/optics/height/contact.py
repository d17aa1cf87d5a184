"""The gel at the contact: the indenter as its ceiling, the gap closed, slopes at the edge."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.arrays import FloatArray, IntArray
from sim.fields.surface import SurfaceState
from sim.optics.height.gradient_recovery import node_gradients, nodes_of

_KINK_SLOPE = 0.8
_TILT_ITERATIONS = 40
_SLOPE_STEP_M = 1e-6


def close_contact(
    surface: SurfaceState, contact_gap_m: float
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Return nodes with the solver's gap closed, the slope at each, and which touch.

    Under a smooth part of the indenter the gel has the indenter's slope; at its rim, where nodes
    next to a touching one lie beside the indenter, that of the free gel.
    """
    nodes = surface.positions.copy()
    ceiling = indenter_height(surface, nodes[:, 0], nodes[:, 1])
    slope = indenter_slope(surface, nodes[:, 0], nodes[:, 1])
    smooth = np.isfinite(slope).all(axis=1)
    steepness = np.where(smooth, np.hypot(*np.where(smooth, slope.T, 0.0)), 0.0)
    touching = (ceiling - nodes[:, 2]) / np.hypot(1.0, steepness) <= contact_gap_m
    nodes[touching, 2] = ceiling[touching]
    gradients = node_gradients(nodes, surface.triangles, surface.triangles6, touching)
    half_covered = ~np.isfinite(ceiling)[surface.triangles].all(axis=1)
    at_rim = nodes_of(surface.triangles[half_covered], len(nodes))
    follows = touching & ~at_rim & smooth
    return nodes, np.where(follows[:, None], slope, gradients), touching


def corner_slopes(
    nodes: FloatArray, triangles: IntArray, gradients: FloatArray, touching: NDArray[np.bool_]
) -> FloatArray:
    """Return slopes at the facets' corners, flat facets where the gel bends sharply off the rim.

    A facet with one foot in the contact whose corner slope differs much from its own plane has
    the rim inside or on its edge; a cubic through that slope would dip below the rim.
    """
    corners = gradients[triangles]
    first, second = (nodes[triangles[:, i]] - nodes[triangles[:, 0]] for i in (1, 2))
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    safe = np.where(area == 0.0, np.inf, area)
    plane = np.stack(
        [
            (first[:, 2] * second[:, 1] - second[:, 2] * first[:, 1]) / safe,
            (second[:, 2] * first[:, 0] - first[:, 2] * second[:, 0]) / safe,
        ],
        axis=1,
    )[:, None, :]
    bends = np.linalg.norm(corners - plane, axis=2).max(axis=1) > _KINK_SLOPE
    kinked = bends & touching[triangles].any(axis=1)
    return np.where(kinked[:, None, None], plane, corners)


def indenter_height(surface: SurfaceState, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the height of the indenter's underside over pad points.

    A tilted indenter is solved for by fixed-point iteration along z, which contracts while tilt
    times slope stays below one; the flanks of a tilted cylinder do not count as underside.

    Args:
        surface: Indenter and pose.
        x: Pad x [m], any shape.
        y: Pad y [m], same shape.

    Returns:
        Heights in the pad's frame [m], same shape; inf beside the indenter.
    """
    rotation = np.asarray(surface.indenter_rotation, dtype=np.float64)
    dx = x - surface.indenter_position[0]
    dy = y - surface.indenter_position[1]
    height = np.zeros_like(dx)
    lateral = rotation[0, 2] * dx + rotation[1, 2] * dy
    upright = np.allclose(rotation[:, 2], (0.0, 0.0, 1.0), atol=1e-12)
    for _ in range(1 if upright else _TILT_ITERATIONS):
        at_x = rotation[0, 0] * dx + rotation[1, 0] * dy + rotation[2, 0] * height
        at_y = rotation[0, 1] * dx + rotation[1, 1] * dy + rotation[2, 1] * height
        underside = surface.indenter.lower_surface(at_x, at_y)
        beside = ~np.isfinite(underside)
        new_height = (np.where(beside, 0.0, underside) - lateral) / rotation[2, 2]
        settled = bool(np.all(np.abs(new_height - height) < 1e-12))
        height = new_height
        if settled:
            break
    return np.where(beside, np.inf, height + surface.indenter_position[2])


def indenter_slope(surface: SurfaceState, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return dz/dx and dz/dy of the indenter's underside, shape [..., 2]; not finite beside it."""
    step = _SLOPE_STEP_M
    with np.errstate(invalid="ignore"):
        along_x = indenter_height(surface, x + step, y) - indenter_height(surface, x - step, y)
        along_y = indenter_height(surface, x, y + step) - indenter_height(surface, x, y - step)
    return np.stack([along_x, along_y], axis=-1) / (2.0 * step)
