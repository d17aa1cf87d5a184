"""Closed surface triangulations of pads, the input of fTetWild."""

from __future__ import annotations

import numpy as np
import scipy.spatial

from sim.arrays import FloatArray, IntArray
from sim.scene.pad import BoxPad, Pad, ParametricPad, SurfacePad
from tacauchy_rig.errors import ConfigError


def pad_surface(
    pad: Pad, *, spacing_m: float, interface_shares: tuple[float, ...] = ()
) -> tuple[FloatArray, IntArray]:
    """Triangulate a pad's surface, outward normals, and the interfaces of its layers.

    A pad from a file keeps its triangles.

    Args:
        pad: The pad.
        spacing_m: About how far apart points of the top lie [m].
        interface_shares: Shares of the local height at which a sheet cuts the pad.

    Returns:
        Vertices [m], shape [vertex_count, 3], and faces [face_count, 3].

    Raises:
        ConfigError: A pad from a file has layers.
    """
    if isinstance(pad, SurfacePad):
        if interface_shares:
            raise ConfigError(
                f"pad {pad.name} comes from a file, and the layers of such a pad are not meshed",
                remedy="give one material, or state the pad as a box or a disc",
            )
        return pad.surface.vertices, pad.surface.faces
    plan, rim_count = _plan(pad, spacing_m)
    top = np.column_stack([plan, pad.height_at(plan[:, 0], plan[:, 1])])
    bottom = np.column_stack([plan, np.zeros(len(plan))])
    triangles = _upward(plan, scipy.spatial.Delaunay(plan).simplices)
    rim = np.arange(rim_count)
    after, below = np.roll(rim, -1), rim + len(plan)
    walls = [
        np.column_stack([below, np.roll(below, -1), after]),
        np.column_stack([below, after, rim]),
    ]
    sheets = [np.column_stack([plan, share * top[:, 2]]) for share in interface_shares]
    cuts = [triangles + (2 + number) * len(plan) for number in range(len(sheets))]
    faces = np.concatenate([triangles, triangles[:, ::-1] + len(plan), *walls, *cuts])
    return np.concatenate([top, bottom, *sheets]), faces.astype(np.int32)


def _plan(pad: ParametricPad, spacing_m: float) -> tuple[FloatArray, int]:
    """Return points seen from above, the outline first and counter-clockwise."""
    if isinstance(pad, BoxPad):
        outline = _rectangle(pad, spacing_m)
    else:
        count = max(24, round(2.0 * np.pi * pad.radius_m / spacing_m))
        angle = 2.0 * np.pi * np.arange(count) / count
        outline = pad.radius_m * np.column_stack([np.cos(angle), np.sin(angle)])
    half = pad.half_extents()
    axes = [np.linspace(-h, h, max(3, round(2.0 * h / spacing_m) + 1)) for h in half]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    inner = grid[pad.distance_to_outline(grid) > 0.4 * spacing_m]
    return np.concatenate([outline, inner]), len(outline)


def _rectangle(pad: BoxPad, spacing_m: float) -> FloatArray:
    x, y = pad.half_extents()
    u = np.linspace(-x, x, max(3, round(2.0 * x / spacing_m) + 1))
    v = np.linspace(-y, y, max(3, round(2.0 * y / spacing_m) + 1))
    sides = [
        np.column_stack([u[:-1], np.full(len(u) - 1, -y)]),
        np.column_stack([np.full(len(v) - 1, x), v[:-1]]),
        np.column_stack([u[:0:-1], np.full(len(u) - 1, y)]),
        np.column_stack([np.full(len(v) - 1, -x), v[:0:-1]]),
    ]
    return np.concatenate(sides)


def _upward(plan: FloatArray, triangles: IntArray) -> IntArray:
    a, b, c = (plan[triangles[:, k]] for k in range(3))
    doubled = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    kept = np.abs(doubled) > 1e-9 * np.abs(doubled).max()
    turned = np.where((doubled < 0.0)[:, None], triangles[:, ::-1], triangles)
    return np.asarray(turned[kept])
