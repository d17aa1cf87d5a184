"""Triangulation of a half section (radius, height), graded away from a stretch of the top edge."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.spatial

from sim.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Grading:
    """Where to be fine, and how fast to coarsen.

    Attributes:
        start_m: The fine stretch of the top edge begins at this radius [m].
        end_m: It ends here [m]; equal to ``start_m`` for the rim of a punch.
        size_m: Edge length on the stretch [m].
        growth: Edge length gained per length of distance from it, plus one.
        size_max_m: Largest edge length [m].
    """

    start_m: float
    end_m: float
    size_m: float
    growth: float = 1.6
    size_max_m: float = 2.5e-3

    def size_at(self, points: FloatArray, height_m: float) -> FloatArray:
        """Return the target edge length at points [count, 2]."""
        nearest = np.clip(points[:, 0], self.start_m, self.end_m)
        distance = np.hypot(points[:, 0] - nearest, points[:, 1] - height_m)
        size = self.size_m + (self.growth - 1.0) / self.growth * distance
        return np.asarray(np.minimum(size, self.size_max_m))


def triangulate_half_section(
    radius_m: float, height_m: float, grading: Grading
) -> tuple[FloatArray, IntArray]:
    """Triangulate the rectangle [0, radius_m] x [0, height_m].

    Returns:
        Points (radius, height) [m], shape [count, 2], and triangles [triangle_count, 3].
    """
    boundary = _boundary(radius_m, height_m, grading)
    interior = _offset_rings(radius_m, height_m, grading)
    size = grading.size_at(interior, height_m)
    margin = np.min(
        [interior[:, 0], radius_m - interior[:, 0], interior[:, 1], height_m - interior[:, 1]],
        axis=0,
    )
    points = np.concatenate([boundary, interior[margin > 0.45 * size]])
    triangles = scipy.spatial.Delaunay(points).simplices
    a, b, c = (points[triangles[:, k]] for k in range(3))
    doubled = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    longest = np.max([((b - a) ** 2).sum(1), ((c - b) ** 2).sum(1), ((a - c) ** 2).sum(1)], axis=0)
    return points, np.asarray(triangles[np.abs(doubled) > 1e-6 * longest], dtype=np.int32)


def _boundary(radius_m: float, height_m: float, grading: Grading) -> FloatArray:
    corners = [(0.0, 0.0), (radius_m, 0.0), (radius_m, height_m)]
    if grading.end_m < radius_m:
        corners.append((grading.end_m, height_m))
    if 0.0 < grading.start_m < grading.end_m:
        corners.append((grading.start_m, height_m))
    corners.append((0.0, height_m))
    path = np.array([*corners, corners[0]])
    sides = [_graded_line(a, b, height_m, grading) for a, b in pairwise(path)]
    return np.concatenate(sides)


def _graded_line(
    start: FloatArray, end: FloatArray, height_m: float, grading: Grading
) -> FloatArray:
    """Return points from ``start`` up to but without ``end``, spaced by the target size."""
    fine = start + np.linspace(0.0, 1.0, 2001)[:, None] * (end - start)
    density = np.linalg.norm(end - start) / grading.size_at(fine, height_m)
    arc = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) / 2000.0)])
    count = max(1, round(float(arc[-1])))
    at = np.interp(np.arange(count) / count * arc[-1], arc, np.linspace(0.0, 1.0, 2001))
    return np.asarray(start + at[:, None] * (end - start))


def _offset_rings(radius_m: float, height_m: float, grading: Grading) -> FloatArray:
    """Return points on curves at growing distance below the fine stretch."""
    rings, distance, size, odd = [], grading.size_m, grading.size_m, False
    while distance < np.hypot(radius_m, height_m):
        rings.append(_offset_curve(distance, size, height_m, grading, staggered=odd))
        size = min(size * grading.growth, grading.size_max_m)
        distance += size
        odd = not odd
    points = np.concatenate(rings)
    inside = (points[:, 0] > 0.0) & (points[:, 0] < radius_m) & (points[:, 1] > 0.0)
    return points[inside]


def _offset_curve(
    distance_m: float, size_m: float, height_m: float, grading: Grading, *, staggered: bool
) -> FloatArray:
    quarter = 0.5 * np.pi * distance_m
    straight = grading.end_m - grading.start_m
    length = 2.0 * quarter + straight
    count = max(3, round(length / size_m))
    at = (np.arange(count) + (0.5 if staggered else 0.0)) / count * length
    angle = (
        np.pi
        + np.where(at < quarter, at, np.where(at < quarter + straight, quarter, at - straight))
        / distance_m
    )
    along = np.clip(at - quarter, 0.0, straight) + grading.start_m
    return np.column_stack(
        [along + distance_m * np.cos(angle), height_m + distance_m * np.sin(angle)]
    )
