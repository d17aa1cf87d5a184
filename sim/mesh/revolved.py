"""Deterministic meshes: a graded half section revolved about the indenter and morphed to the pad.

fTetWild gives another mesh every time it runs. These are the same on every machine, have nodes on
the indenter's rim, are coarse where nothing happens in all three directions, and need no tool.
Neighbouring sectors are mirror images, so a centred press meets a mirror-symmetric mesh.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sim.mesh.graded_plane import Grading, triangulate_half_section
from sim.mesh.symmetry import MirrorSymmetry
from sim.mesh.tet_mesh import TetMesh, oriented
from sim.scene.pad import ParametricPad
from tacauchy_rig.core.arrays import FloatArray, IntArray
from tacauchy_rig.core.errors import ConfigError

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
        centre_m: Axis of revolution, x and y [m], inside the pad.
        symmetry: Planes through the axis that mirror pad and press, of which half or a quarter is
            meshed; None for all on which the axis lies.
        interface_shares: Rising shares of the local height at which layers meet, with nodes there.

    Raises:
        ConfigError: The axis stands outside the pad.
    """
    centre = np.array(centre_m)
    round_m = _round_radius(pad, grading, centre)
    if symmetry is None:
        symmetry = MirrorSymmetry(mirror_x=centre_m[0] == 0.0, mirror_y=centre_m[1] == 0.0)
    angles, reaches, mean_reach = _sectors(pad, centre, sector_count, symmetry)
    if symmetry.copies == 1:
        angles, reaches = angles[:-1], reaches[:-1]
    levels = tuple(share * pad.height_m for share in interface_shares)
    points, triangles, section_layers = triangulate_half_section(
        mean_reach, pad.height_m, grading, levels_m=levels
    )
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
    mesh = TetMesh(vertices=vertices, tets=tets, name=name, symmetry=symmetry)
    return oriented(replace(mesh, layers=layers, axis_m=centre_m))


def _round_radius(pad: ParametricPad, grading: Grading, centre: FloatArray) -> float:
    """Return up to where circles about the axis stay circles [m].

    Raises:
        ConfigError: The axis stands outside the pad, or the indenter's edge does.
    """
    margin = float(pad.distance_to_outline(centre[None, :])[0])
    if margin <= grading.end_m:
        raise ConfigError(
            f"the indenter's edge ({grading.end_m * 1e3:.3g} mm from its axis) does not lie on the "
            f"pad: its axis stands {margin * 1e3:.3g} mm inside the pad's outline",
            remedy="move the indenter inwards",
        )
    return min(_ROUND_SHARE * grading.end_m, 0.5 * (margin + grading.end_m))


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
    triangles: IntArray, on_axis: NDArray[np.bool_], sectors: int, angle_count: int
) -> tuple[IntArray, IntArray]:
    """Cut every triangle times sector in tetrahedra; collapsed ones on the axis are left out.

    Tetrahedra, shape [tet_count, 4], come with the triangle that each is of, shape [tet_count].
    """
    count = len(on_axis)
    a, b, c = np.sort(triangles, axis=1).T
    tets = []
    for sector in range(sectors):
        near, far = sector, (sector + 1) % angle_count
        if sector % 2:
            near, far = far, near
        low = [np.where(on_axis[p], p, p + near * count) for p in (a, b, c)]
        high = [np.where(on_axis[p], p, p + far * count) for p in (a, b, c)]
        tets += [
            np.column_stack([low[0], low[1], low[2], high[2]]),
            np.column_stack([low[0], low[1], high[1], high[2]]),
            np.column_stack([low[0], high[0], high[1], high[2]]),
        ]
    every = np.concatenate(tets)
    ordered = np.sort(every, axis=1)
    kept = np.all(ordered[:, 1:] != ordered[:, :-1], axis=1)
    source = np.tile(np.arange(len(triangles), dtype=np.int32), 3 * sectors)
    return every[kept].astype(np.int32), source[kept]
