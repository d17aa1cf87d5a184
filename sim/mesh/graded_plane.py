"""Triangulation of a half section (radius, height), graded away from a stretch of the top edge.

Levels cut the section into layers. Each is triangulated by itself: the nodes on a level are those
of both sides, and a convex layer's Delaunay triangulation contains its outline, so the two fit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from tacauchy_rig.core.arrays import FloatArray, IntArray
from tacauchy_rig.core.errors import ConfigError

# Edges in a thin layer are at most so many times its thickness.
_THIN_ASPECT = 2.0
# Inner points keep this share of the target edge length from the outline and the levels.
_MARGIN_SHARE = 0.45
# Of the longest side squared: twice the area of a triangle that is a line.
_FLAT = 1e-6
# Samples of a line by which its target edge lengths are summed up.
_LINE_SAMPLES = 2001


@dataclass(frozen=True, slots=True, kw_only=True)
class Grading:
    """Where to be fine, and how fast to coarsen.

    Attributes:
        start_m: The fine stretch of the top edge begins at this radius [m].
        end_m: It ends here [m]; equal to ``start_m`` for the rim of a punch.
        size_m: Edge length on the stretch [m].
        growth: Edge length gained per length of distance from it, plus one.
        size_max_m: Largest edge length [m].
        near_max_m: Largest edge length up to the radius ``near_m`` [m], at every height; farther
            out it may be longer by the distance from there.
    """

    start_m: float
    end_m: float
    size_m: float
    growth: float = 1.6
    size_max_m: float = 2.5e-3
    near_max_m: float = math.inf
    near_m: float = 0.0


def triangulate_half_section(
    radius_m: float, height_m: float, grading: Grading, *, levels_m: tuple[float, ...] = ()
) -> tuple[FloatArray, IntArray, IntArray]:
    """Triangulate the rectangle [0, radius_m] x [0, height_m].

    Args:
        levels_m: Rising heights that no triangle crosses [m].

    Returns:
        Radius and height of the points [m], shape [point_count, 2]; triangles, shape
        [triangle_count, 3]; the layer of each from the base upwards.
    """
    section = _Section(radius_m=radius_m, height_m=height_m, grading=grading, levels_m=levels_m)
    interior = _offset_rings(section)
    across, up = interior.T
    margin = np.min([across, radius_m - across, *(abs(up - z) for z in section.bands_m)], axis=0)
    inner = interior[margin > _MARGIN_SHARE * section.size_at(interior)]
    points = np.concatenate([_boundary(section), inner])
    parts = [_triangulate(points, low, high) for low, high in pairwise(section.bands_m)]
    layers = np.repeat(np.arange(len(parts), dtype=np.int32), [len(part) for part in parts])
    return points, np.concatenate(parts), layers


@dataclass(frozen=True, slots=True, kw_only=True)
class _Section:
    radius_m: float
    height_m: float
    grading: Grading
    levels_m: tuple[float, ...]

    @property
    def bands_m(self) -> tuple[float, ...]:
        return (0.0, *self.levels_m, self.height_m)

    def size_at(self, points: FloatArray) -> FloatArray:
        """Return the target edge length [m] at points [count, 2]; thin layers bound it nearby."""
        grading = self.grading
        slope = (grading.growth - 1.0) / grading.growth
        nearest = np.clip(points[:, 0], grading.start_m, grading.end_m)
        distance = np.hypot(points[:, 0] - nearest, points[:, 1] - self.height_m)
        near_max = grading.near_max_m + np.maximum(points[:, 0] - grading.near_m, 0.0)
        size = np.minimum(grading.size_m + slope * distance, grading.size_max_m)
        size = np.minimum(size, near_max)
        for low, high in pairwise(self.bands_m) if self.levels_m else ():
            outside = np.maximum(0.0, np.maximum(low - points[:, 1], points[:, 1] - high))
            size = np.minimum(size, _THIN_ASPECT * (high - low) + slope * outside)
        return np.asarray(size)


def _triangulate(points: FloatArray, low_m: float, high_m: float) -> IntArray:
    """Return the triangles of the points between two heights, both included."""
    chosen = np.flatnonzero((points[:, 1] >= low_m) & (points[:, 1] <= high_m))
    return chosen[triangulated(points[chosen])].astype(np.int32)


def triangulated(points: FloatArray) -> IntArray:
    """Return the Delaunay triangles of points [point_count, 2] that are no lines, [count, 3]."""
    triangles = scipy.spatial.Delaunay(points).simplices
    a, b, c = (points[triangles[:, k]] for k in range(3))
    doubled = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    longest = np.max([((b - a) ** 2).sum(1), ((c - b) ** 2).sum(1), ((a - c) ** 2).sum(1)], axis=0)
    return np.asarray(triangles[np.abs(doubled) > _FLAT * longest], dtype=np.int32)


def _boundary(section: _Section) -> FloatArray:
    """Return the points on the outline, counter-clockwise from the axis, then on the levels."""
    radius, height, grading = section.radius_m, section.height_m, section.grading
    corners = [(0.0, 0.0), *((radius, z) for z in section.bands_m)]
    if grading.end_m < radius:
        corners.append((grading.end_m, height))
    if 0.0 < grading.start_m < grading.end_m:
        corners.append((grading.start_m, height))
    corners += [(0.0, z) for z in reversed(section.bands_m)]
    sides = [_graded_line(a, b, section) for a, b in pairwise(np.array(corners))]
    across = [np.array([(0.0, z), (radius, z)]) for z in section.levels_m]
    inner = [_graded_line(start, end, section)[1:] for start, end in across]
    return np.concatenate([*sides, *inner])


def _graded_line(start: FloatArray, end: FloatArray, section: _Section) -> FloatArray:
    """Return points from ``start`` up to but without ``end``, spaced by the target size."""
    fine = start + np.linspace(0.0, 1.0, _LINE_SAMPLES)[:, None] * (end - start)
    density = np.linalg.norm(end - start) / section.size_at(fine)
    arc = np.concatenate(
        [[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) / (_LINE_SAMPLES - 1))]
    )
    count = max(1, round(float(arc[-1])))
    at = np.interp(np.arange(count) / count * arc[-1], arc, np.linspace(0.0, 1.0, _LINE_SAMPLES))
    return np.asarray(start + at[:, None] * (end - start))


def _offset_rings(section: _Section) -> FloatArray:
    """Return points on curves at growing distance below the fine stretch."""
    grading, radius, height = section.grading, section.radius_m, section.height_m
    rings, distance, size, odd = [], grading.size_m, grading.size_m, False
    while distance < np.hypot(radius, height):
        rings.append(_offset_curve(distance, size, height, grading, staggered=odd))
        size = min(size * grading.growth, grading.size_max_m)
        distance += size
        odd = not odd
    if not rings:
        raise ConfigError(
            f"edges of {grading.size_m * 1e3:.3g} mm are longer than the pad",
            remedy="choose a finer preset or a larger refinement",
        )
    points = np.concatenate(rings)
    inside = (points[:, 0] > 0.0) & (points[:, 0] < radius) & (points[:, 1] > 0.0)
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
