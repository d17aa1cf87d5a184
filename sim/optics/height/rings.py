"""Circles about the axis of a revolved mesh, drawn as circles.

Such a mesh follows a circle by straight edges. Where the surface bends sharply within the height of
the arc over its chord, as on a punch's wall, the nodes of one circle deform to a star: those in
the middle of chords come out right, those at the ends lie too far out, by half the arc's height
(``docs/optics.md`` has the measurement). What is solved is not changed: only for drawing, the
nodes at the ends of chords are put onto the smooth closed curve through those in the middle.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from sim.arrays import FloatArray, IntArray
from sim.fields.surface import SurfaceState

_SAME_RADIUS_M = 1e-9
_SAME_ANGLE_RAD = 1e-6
_SECTORS_MIN = 4


def with_round_rings(surface: SurfaceState) -> SurfaceState:
    """Return a surface whose circles about the mesh's axis are smooth.

    Surfaces of meshes that were not revolved, and of linear elements, are returned as they are.
    """
    if surface.mesh_axis_m is None or surface.triangles6 is None:
        return surface
    axis = np.array(surface.mesh_axis_m)
    radius, angle = _polar(surface.positions_rest[:, :2] - axis)
    deformed_radius, deformed_angle = _polar(surface.positions[:, :2] - axis)
    turned = _wrapped(deformed_angle - angle)
    place = np.stack([deformed_radius, turned, surface.positions[:, 2]], axis=1)
    drawn = surface.positions.copy()
    for on_rays, in_sectors in _rings(surface.triangles6, radius, angle):
        between = in_sectors[np.argsort(angle[in_sectors])]
        once_more = np.append(between, between[0])
        turn = np.append(angle[between], angle[between[0]] + 2.0 * np.pi)
        curve = CubicSpline(turn, place[once_more], bc_type="periodic")
        at = angle[on_rays]
        out, along, height = curve(at).T
        drawn[on_rays] = np.stack(
            [axis[0] + out * np.cos(at + along), axis[1] + out * np.sin(at + along), height], axis=1
        )
    return replace(surface, positions=drawn)


def _rings(
    triangles6: IntArray, radius: FloatArray, angle: FloatArray
) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield the complete rings: those of corners, and those in the middle between two of them.

    Of each, the nodes on the rays between sectors, and those in the middle of sectors.

    A node in the middle of an edge belongs to the ring that the radii of its ends name: they are
    equal on a chord; of a ring between two others, it is an edge along a ray or a diagonal.
    """
    _, circle = np.unique(np.round(radius / _SAME_RADIUS_M), return_inverse=True)
    corners = np.unique(triangles6[:, :3])
    edges = triangles6[:, [[0, 1, 3], [1, 2, 4], [2, 0, 5]]].reshape(-1, 3)
    edges = edges[np.unique(edges[:, 2], return_index=True)[1]]
    nodes = np.concatenate([corners, edges[:, 2]])
    ends = np.concatenate([np.stack([corners, corners], axis=1), edges[:, :2]])
    names = np.sort(circle[ends], axis=1)
    on_ray = np.abs(_wrapped(angle[ends[:, 0]] - angle[ends[:, 1]])) < _SAME_ANGLE_RAD
    _, ring_of = np.unique(names, axis=0, return_inverse=True)
    order = np.argsort(ring_of, kind="stable")
    for members in np.split(order, np.flatnonzero(np.diff(ring_of.ravel()[order])) + 1):
        on_rays, between = nodes[members[on_ray[members]]], nodes[members[~on_ray[members]]]
        if len(on_rays) == len(between) >= _SECTORS_MIN:
            yield on_rays, between


def _polar(offset: FloatArray) -> tuple[FloatArray, FloatArray]:
    return np.hypot(offset[:, 0], offset[:, 1]), np.arctan2(offset[:, 1], offset[:, 0])


def _wrapped(angle: FloatArray) -> FloatArray:
    """Return angles between -pi and pi [rad]."""
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)
