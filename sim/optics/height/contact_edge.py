"""The gel's surface at the contact's edge: the solver's gap closed, slopes from either side."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.arrays import FloatArray, IntArray
from sim.fields.surface import SurfaceState
from sim.optics.height.contact_bound import indenter_height, indenter_slope
from sim.optics.height.gradient_recovery import node_gradients, nodes_of

_KINK_SLOPE = 0.8


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
