"""The whole pad in linear tetrahedra, which is all that libuipc has."""

from __future__ import annotations

from enum import StrEnum

import numpy as np

from sim.arrays import IntArray
from sim.mesh.elements import quadratic_nodes
from sim.mesh.tet_mesh import TetMesh, oriented

# The parts of a quadratic tetrahedron: four at its corners, four around the line from the middle of
# edge 02 to that of edge 13. Node order is that of sim/elements.py.
_PARTS = (
    (0, 4, 6, 7),
    (1, 5, 4, 8),
    (2, 6, 5, 9),
    (3, 7, 9, 8),
    (6, 8, 4, 5),
    (6, 8, 5, 9),
    (6, 8, 9, 7),
    (6, 8, 7, 4),
)


class PeerMesh(StrEnum):
    """Which of our mesh's points the peer's linear tetrahedra stand on."""

    CORNERS = "same tetrahedra, linear"
    NODES = "same nodes, linear"


def linear_mesh(whole: TetMesh, kind: PeerMesh) -> TetMesh:
    """Return linear tetrahedra on the corners, or on all nodes, of a pad's quadratic ones.

    Args:
        whole: The pad without symmetry.
    """
    if kind is PeerMesh.CORNERS:
        return whole
    nodes, elements = quadratic_nodes(whole.vertices, whole.tets)
    parts: IntArray = np.concatenate([elements[:, list(part)] for part in _PARTS])
    return oriented(nodes, parts, name=f"{whole.name}, each tetrahedron in eight")
