"""Shares of an element's mass that its nodes carry, for straight-sided tetrahedra.

Weight is shared as virtual work shares it: by the integrals of the shape functions. A quadratic
tetrahedron's corners then carry -1/20 of it each, which no mass may be. Inertia is therefore shared
in proportion to the diagonal of the consistent mass matrix (Hinton, Rock, Zienkiewicz 1976), which
is positive.
"""

from __future__ import annotations

import numpy as np

from sim.arrays import FloatArray
from sim.mesh.elements import ElementOrder
from sim.solve.model import Model

_WEIGHT_SHARES = {
    ElementOrder.P1: np.full(4, 1.0 / 4.0),
    ElementOrder.P2: np.array([-1.0 / 20.0] * 4 + [1.0 / 5.0] * 6),
}
_INERTIA_SHARES = {
    ElementOrder.P1: np.full(4, 1.0 / 4.0),
    ElementOrder.P2: np.array([1.0 / 36.0] * 4 + [4.0 / 27.0] * 6),
}


def weighing_masses(model: Model, density_kg_m3: float | FloatArray) -> FloatArray:
    """Return the nodal masses that weight acts on [kg], shape [node_count]; some are negative.

    Args:
        model: The pad.
        density_kg_m3: One number, or one for each tetrahedron.
    """
    return _shared(model, density_kg_m3, _WEIGHT_SHARES[model.reference.order])


def inertial_masses(model: Model, density_kg_m3: float | FloatArray) -> FloatArray:
    """Return the lumped nodal masses [kg], shape [node_count]; all positive.

    Args:
        model: The pad.
        density_kg_m3: One number, or one for each tetrahedron.
    """
    return _shared(model, density_kg_m3, _INERTIA_SHARES[model.reference.order])


def _shared(model: Model, density_kg_m3: float | FloatArray, shares: FloatArray) -> FloatArray:
    corners = model.nodes[model.elements[:, :4]]
    volumes = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0
    masses = np.zeros(len(model.nodes))
    np.add.at(masses, model.elements, (density_kg_m3 * volumes)[:, None] * shares)
    return masses
