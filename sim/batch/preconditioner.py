"""What preconditions a batch: a pilot's stiffnesses, inverted for a GPU, factored for the CPU."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import warp as wp

from sim.arrays import FloatArray
from sim.batch.kernels.dense import DenseProduct
from sim.batch.pilot import Pilot, PilotStiffness
from sim.device import Device
from sim.solve.linear_solver import linear_solver


class Preconditioner(Protocol):
    """Approximate inverses of the stiffness.

    Attributes:
        row_count: Rows of the vectors it takes; those after the unknowns stay zero.
        kind: Warp type of what it takes.
        unit: What it gives must be multiplied with this.
    """

    row_count: int
    kind: Any
    unit: float

    def select(self, which: int) -> None:
        """Take another of the pilot's stiffnesses from now on."""
        ...

    def apply(self, right: Any, out: Any) -> None:
        """Set ``out`` to the inverse times ``right``.

        Args:
            right: Of its own kind, shape [environment_count, row_count].
            out: Float32, the same shape.
        """
        ...


def preconditioner(pilot: Pilot, device: Device) -> Preconditioner:
    """Return the preconditioner that suits a device."""
    if not device.is_gpu:
        return FactoredStiffness(pilot)
    return InvertedStiffness(pilot, device)


class InvertedStiffness:
    """Dense inverses, for vectors on a GPU."""

    def __init__(self, pilot: Pilot, device: Device) -> None:
        self._product = DenseProduct(pilot.inverses(), device=device)
        self.row_count, self.unit = self._product.row_count, self._product.unit
        self.kind = wp.float16

    def select(self, which: int) -> None:
        """Take another of the pilot's stiffnesses from now on."""
        self._product.select(which)

    def apply(self, right: Any, out: Any) -> None:
        """Set ``out`` to the inverse times ``right``, over ``unit``."""
        self._product.apply(right, out)


class FactoredStiffness:
    """Sparse factors, for vectors on the CPU."""

    def __init__(self, pilot: Pilot) -> None:
        self.row_count = pilot.model.pattern.dof_count + pilot.is_pushed
        self.kind, self.unit = wp.float32, 1.0
        self._factors = [_Factor(pilot, stiffness) for stiffness in pilot.stiffnesses]
        self._which = 0

    def select(self, which: int) -> None:
        """Take another of the pilot's stiffnesses from now on."""
        self._which = which

    def apply(self, right: Any, out: Any) -> None:
        """Set ``out`` to the inverse times ``right``."""
        factor, count = self._factors[self._which], self.row_count
        for given, found in zip(right.numpy(), out.numpy(), strict=True):
            # An environment that searches nothing asks for nothing.
            if given.any():
                found[:count] = factor.solve(given[:count].astype(np.float64))


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
