"""Further energies of the nodes: weight, and inertia over one time step.

Implicit Euler's equation of motion, M (x - x_n - dt v_n) / dt^2 = forces(x), says that the
positions at the step's end are stationary for

    1/(2 dt^2) |x - x_hat|_M^2 + energies(x),  x_hat = x_n + dt v_n

so that a step is an equilibrium with one more energy. It is stable for every dt, damps what it does
not resolve, and tends to statics for large dt.

Weight is shared among the nodes of a straight-sided tetrahedron by the integrals of the shape
functions. A quadratic tetrahedron's corners then carry -1/20 of it each, which no mass may be.
Inertia is therefore shared in proportion to the diagonal of the consistent mass matrix (Hinton,
Rock, Zienkiewicz 1976), which is positive.

Densities [kg/m^3] are one number, or one for each tetrahedron.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sim.device import Device
from sim.mesh.cached_tet_mesh import tet_volumes
from sim.mesh.elements import ElementOrder
from sim.solve.descent_state import Pull
from sim.solve.model import Model
from tacauchy_rig.core.arrays import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Potential:
    """k |x - x0|^2 / 2 - F . (x - X), summed over the nodes."""

    stiffness_n_m: FloatArray  # k, shape [node_count]
    towards_m: FloatArray  # x0, shape [node_count, 3]
    force_n: FloatArray  # F, shape [node_count, 3]
    rest_m: FloatArray  # X, shape [node_count, 3]

    def energy(self, positions: FloatArray) -> float:
        """Return the energy at nodal positions [m], shape [node_count, 3]; [J]."""
        away = positions - self.towards_m
        drawn = 0.5 * self.stiffness_n_m[:, None] * away**2
        return float(np.sum(drawn - self.force_n * (positions - self.rest_m)))

    def gradient(self, positions: FloatArray) -> FloatArray:
        """Return its gradient [N], shape [node_count, 3]."""
        away = positions - self.towards_m
        return np.asarray(self.stiffness_n_m[:, None] * away - self.force_n)

    def diagonal(self) -> FloatArray:
        """Return its stiffness [N/m], shape [node_count, 3]."""
        return np.tile(self.stiffness_n_m[:, None], (1, 3))


def pull_of(potential: Potential | None, device: Device) -> Any:
    """Return it for the kernels."""
    if potential is None:
        return device.zeroed(Pull, (1,))
    parts = {"stiffness": potential.diagonal(), "towards": potential.towards_m}
    parts |= {"force": potential.force_n, "rest": potential.rest_m}
    return device.tables(Pull, {name: part.reshape(-1) for name, part in parts.items()})


# Of a tetrahedron's mass, node by node.
Shares = Mapping[ElementOrder, FloatArray]
WEIGHT: Shares = {
    ElementOrder.P1: np.full(4, 1.0 / 4.0),
    ElementOrder.P2: np.array([-1.0 / 20.0] * 4 + [1.0 / 5.0] * 6),
}
INERTIA: Shares = {
    ElementOrder.P1: np.full(4, 1.0 / 4.0),
    ElementOrder.P2: np.array([1.0 / 36.0] * 4 + [4.0 / 27.0] * 6),
}
# Standard gravity (CGPM 1901).
STANDARD_M_S2 = 9.80665


def nodal_masses(model: Model, density_kg_m3: float | FloatArray, shares: Shares) -> FloatArray:
    """Return the lumped nodal masses [kg], shape [node_count].

    Args:
        shares: ``WEIGHT``, by which some are negative, or ``INERTIA``.
    """
    volumes = tet_volumes(model.nodes, model.elements[:, :4])
    masses = np.zeros(len(model.nodes))
    own = (density_kg_m3 * volumes)[:, None] * shares[model.reference.order]
    np.add.at(masses, model.elements, own)
    return masses


def weight(model: Model, density_kg_m3: float | FloatArray) -> Potential:
    """Return the weight of a pad of a sensor that looks up: it acts along -z."""
    masses = nodal_masses(model, density_kg_m3, WEIGHT)
    return Potential(
        stiffness_n_m=np.zeros(len(masses)),
        towards_m=model.nodes,
        force_n=np.outer(masses, (0.0, 0.0, -STANDARD_M_S2)),
        rest_m=model.nodes,
    )


class Inertia:
    """What nodes with mass remember from time step to time step: where they were, and how fast.

    Args:
        step_max_s: Longest time step.

    Attributes:
        masses_kg: Of the modelled part, lumped, shape [node_count].
        velocities_m_s: Shape [node_count, 3].
    """

    def __init__(
        self, model: Model, density_kg_m3: float | FloatArray, *, step_max_s: float = math.inf
    ) -> None:
        self.masses_kg = nodal_masses(model, density_kg_m3, INERTIA)
        self.step_max_s, self._step_s = step_max_s, math.inf
        self.forget(model.nodes)

    def forget(self, positions: FloatArray) -> None:
        """Take the nodes to be at rest at ``positions`` [m], shape [node_count, 3]."""
        self._positions, self.velocities_m_s = positions.copy(), np.zeros_like(positions)

    def begin_step(self, step_s: float) -> None:
        """Prepare a step [s], above 0 to inf, from the last commit; it may be begun again."""
        self._step_s = step_s

    def flight(self, others: Potential | None) -> Potential | None:
        """Return other energies, and what pulls the nodes to where they would fly in the step."""
        if not math.isfinite(self._step_s):
            return others
        flown = self._positions + self._step_s * self.velocities_m_s
        stiffness = self.masses_kg / self._step_s**2
        if others is not None:
            return replace(others, stiffness_n_m=stiffness, towards_m=flown)
        still = np.zeros_like(flown)
        return Potential(stiffness_n_m=stiffness, towards_m=flown, force_n=still, rest_m=flown)

    def commit(self, positions: FloatArray) -> None:
        """Accept ``positions`` [m] as the end of the step that was begun."""
        self.velocities_m_s = (positions - self._positions) / self._step_s
        self._positions = positions.copy()
