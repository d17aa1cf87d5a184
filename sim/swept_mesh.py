"""Deterministic meshes swept from base to top, refined in rings where the indenter's rim lands.

fTetWild gives another mesh every time it runs; these are the same on every machine, carry nodes on
the rim itself, and need no tool. The top is triangulated (Delaunay over graded rings), swept down
in graded layers, and each prism is cut in three tetrahedra.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.spatial

from sim.arrays import FloatArray, IntArray
from sim.mesh import TetMesh, oriented
from sim.pad import Pad


@dataclass(frozen=True, slots=True, kw_only=True)
class SweptSizing:
    """Target sizes of a swept mesh.

    Attributes:
        rim_radius_m: Radius of the ring to refine [m].
        centre_m: Where the indenter stands, x and y [m].
        rim_size_m: Radial edge length at the ring [m].
        growth: Ratio of one ring's width to the next nearer one.
        size_max_m: No edge is meant to be longer [m].
        sector_count: Nodes on the rim.
        layer_top_m: Thickness of the uppermost layer [m].
        layer_growth: Ratio of one layer's thickness to the one above it.
    """

    rim_radius_m: float
    centre_m: tuple[float, float] = (0.0, 0.0)
    rim_size_m: float = 0.2e-3
    growth: float = 1.5
    size_max_m: float = 3.2e-3
    sector_count: int = 24
    layer_top_m: float = 0.25e-3
    layer_growth: float = 1.7


def swept_mesh(pad: Pad, sizing: SweptSizing, *, name: str) -> TetMesh:
    """Mesh a pad."""
    plan = _plan_points(pad, sizing)
    triangles = _triangulate(plan)
    fractions = _layers(pad.height_m, sizing)
    heights = pad.height_at(plan[:, 0], plan[:, 1])
    vertices = np.concatenate(
        [np.column_stack([plan, heights * fraction]) for fraction in fractions]
    )
    tets = [_prisms(triangles, len(plan), layer) for layer in range(len(fractions) - 1)]
    return oriented(vertices, np.concatenate(tets), name=name)


def _layers(height_m: float, sizing: SweptSizing) -> FloatArray:
    """Return the layer interfaces as fractions of the height, from 0 to 1."""
    sizes = [sizing.layer_top_m]
    while sum(sizes) < height_m:
        sizes.append(min(sizes[-1] * sizing.layer_growth, sizing.size_max_m))
    edges = np.concatenate([[0.0], np.cumsum(sizes)]) / sum(sizes)
    return np.asarray(1.0 - edges[::-1])


def _ring_radii(sizing: SweptSizing, reach_m: float) -> list[float]:
    inner, size = [], sizing.rim_size_m
    radius = sizing.rim_radius_m
    while radius > 0.6 * size:
        inner.append(radius)
        radius -= size
        size = min(size * sizing.growth, sizing.rim_radius_m / 3.0)
    outer, size, radius = [], sizing.rim_size_m, sizing.rim_radius_m + sizing.rim_size_m
    while radius < reach_m:
        outer.append(radius)
        size = min(size * sizing.growth, sizing.size_max_m)
        radius += size
    return [*inner[::-1], *outer]


def _plan_points(pad: Pad, sizing: SweptSizing) -> FloatArray:
    """Return the nodes seen from above, x and y [m], shape [count, 2]."""
    outline = pad.outline(sizing.size_max_m)
    centre = np.array(sizing.centre_m)
    reach = float(np.linalg.norm(outline - centre, axis=1).max())
    rings = [centre[None, :]]
    for index, radius in enumerate(_ring_radii(sizing, reach)):
        near = max(sizing.rim_size_m, abs(radius - sizing.rim_radius_m) * (sizing.growth - 1.0))
        spacing = min(
            max(near, 2.0 * np.pi * sizing.rim_radius_m / sizing.sector_count), sizing.size_max_m
        )
        count = max(6, round(2.0 * np.pi * radius / spacing))
        if abs(radius - sizing.rim_radius_m) < 2.5 * sizing.rim_size_m:
            count = sizing.sector_count
        angle = 2.0 * np.pi * (np.arange(count) + 0.5 * (index % 2)) / count
        rings.append(centre + radius * np.column_stack([np.cos(angle), np.sin(angle)]))
    interior = np.concatenate(rings)
    distance = pad.distance_to_outline(interior)
    spacing = np.minimum(
        0.45 * np.maximum(np.linalg.norm(interior - centre, axis=1) * 0.3, sizing.rim_size_m),
        0.4 * sizing.size_max_m,
    )
    return np.concatenate([interior[distance > spacing], outline])


def _triangulate(plan: FloatArray) -> IntArray:
    triangles = scipy.spatial.Delaunay(plan).simplices
    a, b, c = (plan[triangles[:, k]] for k in range(3))
    cross = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    longest = np.max([((b - a) ** 2).sum(1), ((c - b) ** 2).sum(1), ((a - c) ** 2).sum(1)], axis=0)
    return np.asarray(triangles[np.abs(cross) > 1e-9 * longest], dtype=np.int32)


def _prisms(triangles: IntArray, plan_count: int, layer: int) -> IntArray:
    """Cut the prisms of a layer; sorting by node number makes neighbours' diagonals agree."""
    low = np.sort(triangles, axis=1) + layer * plan_count
    high = low + plan_count
    a, b, c = low.T
    d, e, f = high.T
    return np.concatenate(
        [
            np.column_stack([a, b, c, f]),
            np.column_stack([a, b, e, f]),
            np.column_stack([a, d, e, f]),
        ]
    ).astype(np.int32)
