"""The Cauchy stress of a deformed gel, made continuous, with its estimated error.

The elements' stress jumps from one to the next, also within a layer, and its worst value is at
their faces. Its L2 projection onto functions that are linear between the vertices (Oden, Brauchli
1971) is continuous in a layer and of the order of the quadrature points' stress; what the two are
apart is Zienkiewicz and Zhu's (1987) estimate of the elements' error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse.linalg

from sim.mesh.elements import EDGES
from sim.mesh.sparsity import assembled
from sim.mesh.tet_mesh import tet_volumes
from sim.solve.model import Model
from tacauchy_rig.core.arrays import BoolArray, FloatArray

# Of a symmetric tensor, in VTK's order: xx, yy, zz, xy, yz, xz.
_ROWS, _COLUMNS = (0, 1, 2, 0, 1, 0), (0, 1, 2, 1, 2, 2)


@dataclass(frozen=True, slots=True, kw_only=True)
class CauchyStress:
    """Stress of a whole model [Pa].

    Attributes:
        cells_pa: Mean over each tetrahedron's points, shape [tet_count, 3, 3].
        nodes_pa: Recovered; where layers meet, that of the layer above, shape [node_count, 3, 3].
        errors_pa: Estimated error of each tetrahedron's own stress: root mean square of the norm of
            what it and the recovered one are apart, shape [tet_count].
    """

    cells_pa: FloatArray
    nodes_pa: FloatArray
    errors_pa: FloatArray


def cauchy_stress(model: Model, positions: FloatArray) -> CauchyStress:
    """Return the stress where the nodes are [m], shape [node_count, 3]."""
    raw, weights = model.gel.cauchy_stress(positions), model.reference.weights
    labels = model.mesh.layers
    layers = np.zeros(len(raw), dtype=np.int32) if labels is None else labels
    nodes, errors = np.zeros((len(model.nodes), 3, 3)), np.zeros(len(raw))
    for layer in range(int(layers.max()) + 1):
        own = layers == layer
        elements, at_vertices = model.elements[own], recovered_stress(model, positions, own)
        corners = at_vertices[elements[:, :4]]
        nodes[elements[:, :4]] = corners
        for middle, (a, b) in zip(elements[:, 4:].T, EDGES, strict=False):
            nodes[middle] = 0.5 * (at_vertices[elements[:, a]] + at_vertices[elements[:, b]])
        apart = np.einsum("qc,ecij->eqij", model.reference.points, corners) - raw[own]
        errors[own] = np.sqrt(np.einsum("q,eqij,eqij->e", weights, apart, apart))
    cells = np.einsum("q,eqij->eij", weights, raw)
    return CauchyStress(cells_pa=cells, nodes_pa=nodes, errors_pa=errors)


def recovered_stress(model: Model, positions: FloatArray, chosen: BoolArray) -> FloatArray:
    """Return the stress recovered at the vertices of one layer's tetrahedra [Pa], zero elsewhere.

    Args:
        positions: Deformed nodes [m], shape [node_count, 3].
        chosen: Which tetrahedra are of the layer, shape [tet_count].
    """
    corners = model.elements[chosen, :4]
    vertices, local = np.unique(corners, return_inverse=True)
    local = local.reshape(corners.shape)
    values, weights = model.reference.points, model.reference.weights
    volumes = tet_volumes(model.nodes, corners)
    blocks = volumes[:, None, None] * np.einsum("q,qa,qb->ab", weights, values, values)
    if len(weights) == 1:
        # One point cannot tell four vertices apart: lumped, it is the mean over the neighbours.
        blocks = 0.25 * volumes[:, None, None] * np.eye(4)
    # Symmetric: the transpose is the same matrix, by columns.
    mass = assembled(blocks, local, len(vertices)).T
    stress = model.gel.cauchy_stress(positions)[chosen].reshape(*blocks.shape[:1], len(weights), 9)
    loads = np.einsum("e,q,qa,eqs->eas", volumes, weights, values, stress)
    right = np.zeros((len(vertices), 9))
    np.add.at(right, local, loads)
    found = np.zeros((len(model.mesh.vertices), 9))
    found[vertices] = scipy.sparse.linalg.splu(mass).solve(right)
    return found.reshape(-1, 3, 3)


def components(tensors: FloatArray) -> FloatArray:
    """Return xx, yy, zz, xy, yz, xz of symmetric tensors, shape [..., 6]."""
    return np.asarray(tensors[..., _ROWS, _COLUMNS])
