"""Energies of the nodes besides elasticity and contact: weight, inertia."""

from __future__ import annotations

from typing import Protocol

from sim.arrays import FloatArray


class NodalPotential(Protocol):
    """An energy whose stiffness is a constant diagonal."""

    def energy(self, positions: FloatArray) -> float:
        """Return the energy at nodal positions [m], shape [node_count, 3]; [J]."""
        ...

    def gradient(self, positions: FloatArray) -> FloatArray:
        """Return its gradient [N], shape [node_count, 3]."""
        ...

    def diagonal(self) -> FloatArray:
        """Return its stiffness [N/m], shape [node_count, 3]."""
        ...
