"""Deterministic meshes: a graded half section revolved about the indenter and morphed to the pad.

docs/explanation/meshes.md describes them. Neighbouring sectors are mirror images, so a centred
press meets a mirror-symmetric mesh. Levels cut the half section (radius, height) into layers. Each
is triangulated by itself: the nodes on a level are those of both sides, and a convex layer's
Delaunay triangulation contains its outline, so the two fit.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np
import scipy

from sim.mesh.cached_tet_mesh import TetMesh, oriented
from sim.mesh.mirror_symmetry import MirrorSymmetry
from sim.scene.pad import ParametricPad
from tacauchy_rig.core.arrays import BoolArray, FloatArray, IntArray
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
    """Where to be fine, and how fast to coarsen."""

    start_m: float  # the fine stretch of the top edge begins at this radius [m]
    end_m: float  # it ends here [m]; equal to ``start_m`` for the rim of a punch
    size_m: float  # edge length on the stretch [m]
    growth: float = 1.6  # edge length gained per length of distance from it, plus one
    size_max_m: float = 2.5e-3  # largest edge length [m]
    # Largest edge length up to the radius ``near_m`` [m], at every height; farther out it, and that
    # of thin layers, may be longer by the distance from there
    near_max_m: float = math.inf
    near_m: float = 0.0


def _half_section(
    radius_m: float, bands_m: tuple[float, ...], grading: Grading
) -> tuple[FloatArray, IntArray, IntArray]:
    """Triangulate the section up to a radius; no triangle crosses one of the rising heights [m].

    Returned are the points' radius and height [m], the triangles, and the layer of each.
    """
    size_at = partial(_target_size, bands_m=bands_m, grading=grading)
    interior = _offset_rings(radius_m, bands_m[-1], grading)
    across, up = interior.T
    margin = np.min([across, radius_m - across, *(abs(up - z) for z in bands_m)], axis=0)
    inner = interior[margin > _MARGIN_SHARE * size_at(interior)]
    points = np.concatenate([_boundary(radius_m, bands_m, grading, size_at), inner])
    parts = []
    for low, high in pairwise(bands_m):
        chosen = np.flatnonzero((points[:, 1] >= low) & (points[:, 1] <= high))
        parts.append(chosen[triangulated(points[chosen])].astype(np.int32))
    layers = np.repeat(np.arange(len(parts), dtype=np.int32), [len(part) for part in parts])
    return points, np.concatenate(parts), layers


def _target_size(points: FloatArray, bands_m: tuple[float, ...], grading: Grading) -> FloatArray:
    """Return the target edge length [m] at points [count, 2]; thin layers bound it nearby."""
    slope = (grading.growth - 1.0) / grading.growth
    nearest = np.clip(points[:, 0], grading.start_m, grading.end_m)
    distance = np.hypot(points[:, 0] - nearest, points[:, 1] - bands_m[-1])
    beyond = np.maximum(points[:, 0] - grading.near_m, 0.0)
    size = np.minimum(grading.size_m + slope * distance, grading.size_max_m)
    size = np.minimum(size, grading.near_max_m + beyond)
    for low, high in pairwise(bands_m) if len(bands_m) > 2 else ():
        outside = np.maximum(0.0, np.maximum(low - points[:, 1], points[:, 1] - high))
        size = np.minimum(size, _THIN_ASPECT * (high - low) + slope * outside + beyond)
    return np.asarray(size)


def triangulated(points: FloatArray) -> IntArray:
    """Return the Delaunay triangles of points [point_count, 2] that are no lines, [count, 3]."""
    triangles = scipy.spatial.Delaunay(points).simplices
    a, b, c = (points[triangles[:, k]] for k in range(3))
    doubled = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    longest = np.max([((b - a) ** 2).sum(1), ((c - b) ** 2).sum(1), ((a - c) ** 2).sum(1)], axis=0)
    return np.asarray(triangles[np.abs(doubled) > _FLAT * longest], dtype=np.int32)


def _boundary(
    radius_m: float,
    bands_m: tuple[float, ...],
    grading: Grading,
    size_at: Callable[[FloatArray], FloatArray],
) -> FloatArray:
    """Return the points on the outline, counter-clockwise from the axis, then on the levels."""
    corners = [(0.0, 0.0), *((radius_m, z) for z in bands_m)]
    if grading.end_m < radius_m:
        corners.append((grading.end_m, bands_m[-1]))
    if 0.0 < grading.start_m < grading.end_m:
        corners.append((grading.start_m, bands_m[-1]))
    corners += [(0.0, z) for z in reversed(bands_m)]
    sides = [_graded_line(a, b, size_at) for a, b in pairwise(np.array(corners))]
    across = [np.array([(0.0, z), (radius_m, z)]) for z in bands_m[1:-1]]
    inner = [_graded_line(start, end, size_at)[1:] for start, end in across]
    return np.concatenate([*sides, *inner])


def _graded_line(
    start: FloatArray, end: FloatArray, size_at: Callable[[FloatArray], FloatArray]
) -> FloatArray:
    """Return points from ``start`` up to but without ``end``, spaced by the target size."""
    fine = start + np.linspace(0.0, 1.0, _LINE_SAMPLES)[:, None] * (end - start)
    density = np.linalg.norm(end - start) / size_at(fine)
    parts = 0.5 * (density[1:] + density[:-1]) / (_LINE_SAMPLES - 1)
    arc = np.concatenate([[0.0], np.cumsum(parts)])
    count = max(1, round(float(arc[-1])))
    at = np.interp(np.arange(count) / count * arc[-1], arc, np.linspace(0.0, 1.0, _LINE_SAMPLES))
    return np.asarray(start + at[:, None] * (end - start))


def _offset_rings(radius_m: float, height_m: float, grading: Grading) -> FloatArray:
    """Return points on curves at growing distance below the fine stretch."""
    rings: list[FloatArray] = []
    distance = size = grading.size_m
    while distance < np.hypot(radius_m, height_m):
        start = 0.5 if len(rings) % 2 else 0.0
        rings.append(_offset_curve(distance, size, height_m, grading, start=start))
        size = min(size * grading.growth, grading.size_max_m)
        distance += size
    if not rings:
        raise ConfigError(
            f"edges of {grading.size_m * 1e3:.3g} mm are longer than the pad",
            remedy="choose a finer preset or a larger refinement",
        )
    points = np.concatenate(rings)
    inside = (points[:, 0] > 0.0) & (points[:, 0] < radius_m) & (points[:, 1] > 0.0)
    return points[inside]


def _offset_curve(
    distance_m: float, size_m: float, height_m: float, grading: Grading, *, start: float
) -> FloatArray:
    quarter = 0.5 * np.pi * distance_m
    straight = grading.end_m - grading.start_m
    length = 2.0 * quarter + straight
    count = max(3, round(length / size_m))
    at = (np.arange(count) + start) / count * length
    bent = np.where(at < quarter, at, np.where(at < quarter + straight, quarter, at - straight))
    angle = np.pi + bent / distance_m
    along = np.clip(at - quarter, 0.0, straight) + grading.start_m
    across, up = distance_m * np.cos(angle), distance_m * np.sin(angle)
    return np.column_stack([along + across, height_m + up])


# Rings stay circles up to so many radii of the fine stretch; farther out they take the pad's shape.
_ROUND_SHARE = 1.6
_ON_AXIS_M = 1e-12


def revolved_mesh(
    pad: ParametricPad,
    grading: Grading,
    *,
    centre_m: tuple[float, float],
    sector_count: int,
    name: str,
    symmetry: MirrorSymmetry | None = None,
    interface_shares: tuple[float, ...] = (),
) -> TetMesh:
    """Mesh a pad.

    Args:
        centre_m: Axis of revolution, x and y [m], farther inside the pad than ``end_m``.
        symmetry: Planes through the axis that mirror pad and press, of which half or a quarter is
            meshed; None for all on which the axis lies.
        interface_shares: Rising shares of the local height at which layers meet, with nodes there.
    """
    centre = np.array(centre_m)
    margin = float(pad.distance_to_outline(centre[None, :])[0])
    round_m = min(_ROUND_SHARE * grading.end_m, 0.5 * (margin + grading.end_m))
    if symmetry is None:
        symmetry = MirrorSymmetry(mirror_x=centre_m[0] == 0.0, mirror_y=centre_m[1] == 0.0)
    angles, reaches, mean_reach = _sectors(pad, centre, sector_count, symmetry)
    if symmetry.copies == 1:
        angles, reaches = angles[:-1], reaches[:-1]
    levels = (share * pad.height_m for share in interface_shares)
    bands = (0.0, *levels, pad.height_m)
    points, triangles, section_layers = _half_section(mean_reach, bands, grading)
    # Radii beyond the round part are stretched so that the outermost meets the outline.
    share = np.clip((points[:, 0] - round_m) / (mean_reach - round_m), 0.0, 1.0)
    stretched = points[:, 0] + share * (reaches - mean_reach)[:, None]
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    plan = stretched[..., None] * directions[:, None] + centre
    # Heights are of a section that is as high all over; they are scaled to the pad's top.
    z = pad.height_at(plan[..., 0], plan[..., 1]) * points[:, 1] / pad.height_m
    vertices = np.concatenate([plan, z[..., None]], axis=2).reshape(-1, 3)
    on_axis = points[:, 0] <= _ON_AXIS_M
    sectors = len(angles) if symmetry.copies == 1 else len(angles) - 1
    tets, source = _revolve(triangles, on_axis, sectors, len(angles))
    layers = section_layers[source] if interface_shares else None
    vertices[symmetry.on_plane(vertices, mean_reach)] = 0.0
    mesh = TetMesh(
        vertices=vertices, tets=tets, name=name, symmetry=symmetry, layers=layers, axis_m=centre_m
    )
    return oriented(mesh)


def _sectors(
    pad: ParametricPad, centre: FloatArray, count: int, symmetry: MirrorSymmetry
) -> tuple[FloatArray, FloatArray, float]:
    """Return directions of the modelled part [rad], the outline's distances, and their mean [m]."""
    start, end = 0.0, np.pi * (1.0 if symmetry.mirror_y else 2.0)
    if symmetry.mirror_x:
        start, end = (0.0 if symmetry.mirror_y else -0.5 * np.pi), 0.5 * np.pi
    angles, reaches = pad.sectors(centre, count, start_rad=start, end_rad=end)
    return angles, reaches, float(0.5 * (reaches[1:] + reaches[:-1]).mean())


def _revolve(
    triangles: IntArray, on_axis: BoolArray, sectors: int, angle_count: int
) -> tuple[IntArray, IntArray]:
    """Cut every triangle times sector in tetrahedra, and say which triangle each is of."""
    count = len(on_axis)
    a, b, c = np.sort(triangles, axis=1).T
    tets = []
    for sector in range(sectors):
        near, far = sector, (sector + 1) % angle_count
        if sector % 2:
            near, far = far, near
        low = [np.where(on_axis[p], p, p + near * count) for p in (a, b, c)]
        high = [np.where(on_axis[p], p, p + far * count) for p in (a, b, c)]
        tets += [np.column_stack([*low[: k + 1], *high[k:]]) for k in (2, 1, 0)]
    every = np.concatenate(tets)
    ordered = np.sort(every, axis=1)
    kept = np.all(ordered[:, 1:] != ordered[:, :-1], axis=1)
    source = np.tile(np.arange(len(triangles), dtype=np.int32), 3 * sectors)
    return every[kept].astype(np.int32), source[kept]
