"""What preconditions a batch: a pilot's stiffnesses, inverted for a GPU, factored for the CPU."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from sim.arrays import FloatArray
from sim.batch.dense import DenseProduct
from sim.batch.pilot import Pilot, PilotStiffness
from sim.device import Device
from sim.linear_solver import linear_solver


class Preconditioner(Protocol):
    """Approximate inverses of the stiffness.

    Attributes:
        row_count: Rows of the vectors it takes; those after the unknowns stay zero.
    """

    row_count: int

    def select(self, which: int) -> None:
        """Take another of the pilot's stiffnesses from now on."""
        ...

    def apply(self, right: Any, out: Any, dots_out: Any) -> None:
        """Set ``out`` to the inverse times ``right``, and add ``right . out``.

        Args:
            right: Shape [row_count, environment_count], float32.
            out: The same shape.
            dots_out: Shape [environment_count], float64.
        """
        ...


def preconditioner(pilot: Pilot, device: Device) -> Preconditioner:
    """Return the preconditioner that suits a device."""
    if not device.is_gpu:
        return FactoredStiffness(pilot)
    pattern = pilot.model.pattern
    inverses = np.stack([stiffness.inverse(pattern) for stiffness in pilot.stiffnesses])
    return DenseProduct(inverses, device=device)


class FactoredStiffness:
    """Sparse factors, for vectors on the CPU."""

    def __init__(self, pilot: Pilot) -> None:
        self._count = pilot.model.pattern.dof_count
        self.row_count = self._count + pilot.is_pushed
        self._factors = [_Factor(pilot, stiffness) for stiffness in pilot.stiffnesses]
        self._which = 0

    def select(self, which: int) -> None:
        """Take another of the pilot's stiffnesses from now on."""
        self._which = which

    def apply(self, right: Any, out: Any, dots_out: Any) -> None:
        """Set ``out`` to the inverse times ``right``, and add ``right . out``."""
        given, found, dots = right.numpy(), out.numpy(), dots_out.numpy()
        for column in range(given.shape[1]):
            vector = given[:, column].astype(np.float64)
            # An environment that searches nothing has no residual.
            if vector.any():
                found[:, column] = solution = self._factors[self._which].solve(vector)
                dots[column] += vector @ solution


class _Factor:
    """One stiffness; the indenter's height, if it is an unknown, borders the sparse part."""

    def __init__(self, pilot: Pilot, stiffness: PilotStiffness) -> None:
        self._solver = linear_solver(pilot.model.pattern, refined=False)
        self._solver.factorise(stiffness.data)
        self._border = stiffness.border
        if self._border is not None:
            self._along = self._solver.solve(self._border)
            self._corner = stiffness.corner - float(self._border @ self._along)

    def solve(self, vector: FloatArray) -> FloatArray:
        if self._border is None:
            return self._solver.solve(vector)
        unknowns = self._solver.solve(vector[:-1])
        lift = (vector[-1] - self._border @ unknowns) / self._corner
        return np.append(unknowns - lift * self._along, lift)
