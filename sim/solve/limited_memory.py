"""What the last steps have shown of a Hessian, added to an inverse that is about right (L-BFGS).

Nocedal and Wright, Numerical Optimization, algorithm 7.4.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np
from scipy.linalg.blas import daxpy

from sim.arrays import FloatArray

# Steps with less curvature are not learnt from: s . y over |s| |y|, which rounding would decide.
_CURVATURE_MIN = 1e-12


class LimitedMemory:
    """Steps and how they changed the gradient.

    Args:
        length: Steps that are remembered.
    """

    def __init__(self, length: int) -> None:
        self._pairs: deque[tuple[FloatArray, FloatArray, float]] = deque(maxlen=length)

    def __len__(self) -> int:
        return len(self._pairs)

    def forget(self) -> None:
        """Begin anew, since another inverse takes over."""
        self._pairs.clear()

    def learn(self, step: FloatArray, change: FloatArray) -> None:
        """Remember how a step changed the gradient, unless it went along no curvature."""
        curvature = float(step @ change)
        if curvature > _CURVATURE_MIN * np.linalg.norm(step) * np.linalg.norm(change):
            self._pairs.append((step, change, 1.0 / curvature))

    def direction(
        self, gradient: FloatArray, inverse: Callable[[FloatArray], FloatArray]
    ) -> FloatArray:
        """Return minus the inverse Hessian times a gradient.

        Args:
            inverse: Applies the inverse that is about right.
        """
        left = -gradient
        shares = []
        for step, change, scale in reversed(self._pairs):
            shares.append(scale * float(step @ left))
            left = daxpy(change, left, a=-shares[-1])
        found = inverse(left)
        for step, change, scale in self._pairs:
            found = daxpy(step, found, a=shares.pop() - scale * float(change @ found))
        return found
