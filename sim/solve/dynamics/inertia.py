"""Inertia over one time step, as an energy of the nodes.

Implicit Euler's equation of motion, M (x - x_n - dt v_n) / dt^2 = forces(x), says that the
positions at the step's end are stationary for

    1/(2 dt^2) |x - x_hat|_M^2 + energies(x),  x_hat = x_n + dt v_n

so that a step is an equilibrium with one more energy. It is stable for every dt, damps what it does
not resolve, and tends to statics for large dt.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.arrays import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Inertia:
    """What pulls the nodes to where they would fly in one step.

    Attributes:
        masses_kg: Lumped nodal masses, shape [node_count].
        flown_m: x_hat, where each node would be without forces, shape [node_count, 3].
        step_s: dt.
    """

    masses_kg: FloatArray
    flown_m: FloatArray
    step_s: float

    def energy(self, positions: FloatArray) -> float:
        """Return the incremental energy [J]."""
        away = positions - self.flown_m
        return 0.5 * float(np.sum(self._stiffness[:, None] * away * away))

    def gradient(self, positions: FloatArray) -> FloatArray:
        """Return mass times acceleration [N], shape [node_count, 3]."""
        return np.asarray(self._stiffness[:, None] * (positions - self.flown_m))

    def diagonal(self) -> FloatArray:
        """Return M / dt^2 [N/m], shape [node_count, 3]."""
        return np.tile(self._stiffness[:, None], (1, 3))

    @property
    def _stiffness(self) -> FloatArray:
        return self.masses_kg / self.step_s**2
