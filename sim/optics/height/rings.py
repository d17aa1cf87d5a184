"""Circles about the axis of a revolved mesh, drawn as circles.

Such a mesh follows a circle by straight edges. Where the surface bends sharply within the height of
the arc over its chord, as on a punch's wall, the nodes of one circle deform to a star: those in
the middle of chords come out right, those at the ends lie too far out, by half the arc's height
(``docs/explanation/optics.md``). What is solved is not changed: only for drawing, the
nodes at the ends of chords are put onto the smooth closed curve through those in the middle.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.interpolate import CubicSpline

from tacauchy_rig.core.arrays import AnyArray, FloatArray, IntArray

_SAME_RADIUS_M = 1e-9
_SAME_ANGLE_RAD = 1e-6
_SECTORS_MIN = 4


def round_rings(
    rest: FloatArray, faces: IntArray, axis_m: tuple[float, float]
) -> dict[str, AnyArray]:
    """Return what draws circles of a revolved mesh smooth, as tables of ``node_kernel.Gel``.

    A periodic cubic spline is linear in its values: its weights are fixed by the mesh at rest.

    Args:
        rest: Nodes at rest [m], shape [node_count, 3].
        faces: Quadratic ones, shape [face_count, 6].
        axis_m: x and y [m].
    """
    offset = rest[:, :2] - np.array(axis_m)
    radius, angle = np.hypot(*offset.T), np.arctan2(offset[:, 1], offset[:, 0])
    rings = list(_rings(faces, radius, angle))
    sectors = max((len(rays) for rays, _ in rings), default=0)
    between, on_rays, weights = [], [], []
    for rays, middles in rings:
        if len(rays) == sectors:
            ordered = middles[np.argsort(angle[middles])]
            turn = np.append(angle[ordered], angle[ordered[0]] + 2.0 * np.pi)
            ones = np.eye(sectors)[[*range(sectors), 0]]
            weights.append(CubicSpline(turn, ones, bc_type="periodic")(angle[rays]))
            between.append(ordered)
            on_rays.append(rays)
    shape = (len(between), sectors)
    return {
        "angle": angle,
        "between": np.array(between, dtype=np.int32).reshape(shape),
        "on_rays": np.array(on_rays, dtype=np.int32).reshape(shape),
        "weights": np.array(weights, dtype=np.float64).reshape(*shape, sectors),
    }


def _rings(
    faces: IntArray, radius: FloatArray, angle: FloatArray
) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield the complete rings: those of corners, and those in the middle between two of them.

    Of each, the nodes on the rays between sectors, and those in the middle of sectors.

    A node in the middle of an edge belongs to the ring that the radii of its ends name: they are
    equal on a chord; of a ring between two others, it is an edge along a ray or a diagonal.
    """
    _, circle = np.unique(np.round(radius / _SAME_RADIUS_M), return_inverse=True)
    corners = np.unique(faces[:, :3])
    edges = faces[:, [[0, 1, 3], [1, 2, 4], [2, 0, 5]]].reshape(-1, 3)
    edges = edges[np.unique(edges[:, 2], return_index=True)[1]]
    nodes = np.concatenate([corners, edges[:, 2]])
    ends = np.concatenate([np.stack([corners, corners], axis=1), edges[:, :2]])
    names = np.sort(circle[ends], axis=1)
    turn = angle[ends[:, 0]] - angle[ends[:, 1]]
    on_ray = np.abs((turn + np.pi) % (2.0 * np.pi) - np.pi) < _SAME_ANGLE_RAD
    _, ring_of = np.unique(names, axis=0, return_inverse=True)
    order = np.argsort(ring_of, kind="stable")
    for members in np.split(order, np.flatnonzero(np.diff(ring_of.ravel()[order])) + 1):
        on_rays, between = nodes[members[on_ray[members]]], nodes[members[~on_ray[members]]]
        if len(on_rays) == len(between) >= _SECTORS_MIN:
            yield on_rays, between
