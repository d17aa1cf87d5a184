"""A gel small enough for tests: a spring beside a spring and damper in series.

Standard linear solid under a flat punch, F = k (1 - r) d + q, dq/dt = k r dd/dt - q / tau:
after a step in depth d the force relaxes by the fraction r over some tau seconds.
"""

from __future__ import annotations

import math


class Gel:
    """Pressing force of an indenter that moves along one line.

    Args:
        stiffness_n_m: Instantaneous stiffness k [N/m].
        relaxed_fraction: Fraction r of the force that relaxes.
        relaxation_time_s: Time constant tau [s].
    """

    def __init__(
        self,
        *,
        stiffness_n_m: float = 3500.0,
        relaxed_fraction: float = 0.07,
        relaxation_time_s: float = 2.0,
    ) -> None:
        self.stiffness_n_m = stiffness_n_m
        self.relaxed_fraction = relaxed_fraction
        self.relaxation_time_s = relaxation_time_s
        self._depth_m = 0.0
        self._memory_n = 0.0

    def press(self, depth_m: float, *, duration_s: float) -> float:
        """Move to ``depth_m`` [m] within ``duration_s`` [s]; return the pressing force [N]."""
        depth_m = max(depth_m, 0.0)
        decay = math.exp(-duration_s / self.relaxation_time_s)
        step = self.stiffness_n_m * self.relaxed_fraction * (depth_m - self._depth_m)
        self._memory_n = self._memory_n * decay + step
        self._depth_m = depth_m
        if depth_m == 0.0:
            return 0.0
        return max(0.0, self.stiffness_n_m * (1 - self.relaxed_fraction) * depth_m + self._memory_n)
