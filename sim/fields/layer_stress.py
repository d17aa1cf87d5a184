"""Stress of one layer, made continuous within it: from its own elements and no others.

The elements' stress jumps from one to the next, also within a layer, and its worst value is at
their faces. Its L2 projection onto functions that are linear between the vertices (Oden, Brauchli
1971) is continuous in the layer and of the order of the quadrature points' stress.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from numpy.typing import NDArray

from sim.arrays import FloatArray
from sim.solve.model import Model


def layer_stress(model: Model, positions: FloatArray, chosen: NDArray[np.bool_]) -> FloatArray:
    """Return the Cauchy stress at the vertices of some tetrahedra [Pa], zero elsewhere.

    Args:
        positions: Deformed nodes [m], shape [node_count, 3].
        chosen: Which tetrahedra are of the layer, shape [tet_count].

    Returns:
        Shape [vertex_count, 3, 3].
    """
    corners = model.elements[chosen, :4]
    vertices, local = np.unique(corners, return_inverse=True)
    local = local.reshape(corners.shape)
    values, weights = model.reference.points, model.reference.weights
    sides = model.nodes[corners[:, 1:]] - model.nodes[corners[:, :1]]
    volumes = np.linalg.det(sides) / 6.0
    blocks = volumes[:, None, None] * np.einsum("q,qa,qb->ab", weights, values, values)
    if len(weights) == 1:
        # One point cannot tell four vertices apart: lumped, it is the mean over the neighbours.
        blocks = 0.25 * volumes[:, None, None] * np.eye(4)
    rows, columns = np.broadcast_arrays(local[:, :, None], local[:, None, :])
    mass = scipy.sparse.csc_matrix(
        (blocks.reshape(-1), (rows.reshape(-1), columns.reshape(-1))),
        shape=(len(vertices), len(vertices)),
    )
    stress = model.cauchy_stress(positions)[chosen].reshape(*blocks.shape[:1], len(weights), 9)
    loads = np.einsum("e,q,qa,eqs->eas", volumes, weights, values, stress)
    right = np.zeros((len(vertices), 9))
    np.add.at(right, local, loads)
    found = np.zeros((len(model.mesh.vertices), 9))
    found[vertices] = scipy.sparse.linalg.splu(mass).solve(right)
    return found.reshape(-1, 3, 3)
