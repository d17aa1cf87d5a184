"""Regular coarse meshes of a box: cells of six tetrahedra around a diagonal (Kuhn).

Halving the longest edges of such cells gives three shapes of tetrahedra and no others.
"""

from __future__ import annotations

import math
from itertools import permutations

import numpy as np

from sim.arrays import IntArray
from sim.mesh.symmetry import MirrorSymmetry
from sim.mesh.tet_mesh import TetMesh, oriented
from sim.scene.pad import BoxPad


def brick_mesh(pad: BoxPad, *, spacing_m: float, symmetry: MirrorSymmetry) -> TetMesh:
    """Mesh a box, or the part that stands for the whole, by cells of at most ``spacing_m`` [m]."""
    half_x, half_y = pad.half_extents()
    ends = (
        (0.0 if symmetry.mirror_x else -half_x, half_x),
        (0.0 if symmetry.mirror_y else -half_y, half_y),
        (0.0, 1.0),
    )
    sizes = np.ptp(ends, axis=1) * (1.0, 1.0, pad.height_m)
    cells = tuple(math.ceil(size / spacing_m) for size in sizes)
    axes = [np.linspace(*end, count + 1) for end, count in zip(ends, cells, strict=True)]
    vertices = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    vertices[:, 2] *= pad.height_at(vertices[:, 0], vertices[:, 1])
    name = f"{cells[0]}x{cells[1]}x{cells[2]} cells"
    tets = kuhn_tets(cells)
    return oriented(TetMesh(vertices=vertices, tets=tets, name=name, symmetry=symmetry))


def kuhn_tets(cells: tuple[int, ...]) -> IntArray:
    """Return the tetrahedra of a grid of cells, shape [6 cell_count, 4], the last axis fastest."""
    strides = np.array([(cells[1] + 1) * (cells[2] + 1), cells[2] + 1, 1])
    corners = np.stack(np.meshgrid(*[np.arange(n) for n in cells], indexing="ij"), axis=-1)
    first = corners.reshape(-1, 3) @ strides
    ways = [np.append(0, np.cumsum(strides[list(order)])) for order in permutations(range(3))]
    return np.concatenate([first[:, None] + way for way in ways]).astype(np.int32)
