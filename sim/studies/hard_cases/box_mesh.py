"""Regular tetrahedral boxes: meshes that know nothing of the indenter."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from sim.arrays import FloatArray
from sim.mesh.symmetry import MirrorSymmetry
from sim.mesh.tet_mesh import TetMesh, oriented


def box_mesh(
    size_m: tuple[float, float, float],
    cells: tuple[int, int, int],
    *,
    jitter: float = 0.0,
    quarter: bool = False,
) -> TetMesh:
    """Cut a box into cells and each cell into the six tetrahedra around its diagonal (Kuhn).

    Args:
        size_m: Extents in x, y and z [m]; centred in x and y, base at z = 0.
        cells: How many cells along each axis.
        jitter: Random shift of the interior nodes, in cell sizes, always the same for a mesh.
        quarter: Mesh the quarter at x, y >= 0 of a box whose mirror images are the rest; extents
            and cells are the quarter's.
    """
    axes = [np.linspace(0.0, 1.0, count + 1) for count in cells]
    shares = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    if jitter:
        inner = np.all((shares > 1e-9) & (shares < 1.0 - 1e-9), axis=1)
        noise = np.random.default_rng(20).uniform(-jitter, jitter, size=shares.shape)
        shares = shares + np.where(inner[:, None], noise / np.array(cells), 0.0)
    origin = np.zeros(3) if quarter else np.array([0.5, 0.5, 0.0])
    vertices: FloatArray = (shares - origin) * np.array(size_m)
    strides = np.array([(cells[1] + 1) * (cells[2] + 1), cells[2] + 1, 1])
    corners = np.stack(np.meshgrid(*[np.arange(n) for n in cells], indexing="ij"), axis=-1)
    first = corners.reshape(-1, 3) @ strides
    tets = []
    for order in permutations(range(3)):
        steps = np.concatenate([[0], np.cumsum(strides[list(order)])])
        tets.append(first[:, None] + steps)
    return oriented(
        vertices,
        np.concatenate(tets),
        name=f"box, {cells[0]}x{cells[1]}x{cells[2]}",
        symmetry=MirrorSymmetry(mirror_x=quarter, mirror_y=quarter),
    )
