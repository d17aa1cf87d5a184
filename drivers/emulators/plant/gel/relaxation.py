"""Stress relaxation by quasi-linear viscoelasticity (Fung 1993, section 7.6).

F(t) = Fe(t) + sum_i g_i integral exp(-(t - s) / tau_i) dFe(s): ``Fe`` is the relaxed (long-term)
force of the depth, and a fast press feels (1 + sum g_i) times as much. For a rate that is constant
over a step the integral is advanced exactly.
"""

from __future__ import annotations

import math


class Relaxation:
    """The force's memory, advanced one sample at a time."""

    def __init__(self, weights: tuple[float, ...], times_s: tuple[float, ...]) -> None:
        self._weights = weights
        self._times_s = times_s
        self._memory = [0.0] * len(weights)
        self._relaxed = 0.0

    def advance(self, relaxed: float, duration_s: float) -> float:
        """Return the force after ``duration_s`` [s] in which the relaxed force came to ``relaxed``.

        Out of contact (``relaxed`` zero) the memory fades and the force is zero: gel that has not
        yet risen does not pull.
        """
        change = relaxed - self._relaxed
        self._relaxed = relaxed
        for i, (weight, time_s) in enumerate(zip(self._weights, self._times_s, strict=True)):
            x = duration_s / time_s
            mean = -math.expm1(-x) / x if x > 0.0 else 1.0
            self._memory[i] = self._memory[i] * math.exp(-x) + weight * change * mean
        return max(0.0, relaxed + sum(self._memory)) if relaxed > 0.0 else 0.0
