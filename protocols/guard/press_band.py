"""Between which forces a press into the stated gel must lie, from what it gave before.

Where the gel begins is known from the force sensor alone, and to the contact force at best. So the
band is one of rises: from each point of a press to each later, deeper one the force must rise by
what the gel gives between the two depths, times what is left open of its stiffness.

A flat face that leans comes into contact by and by. Its force is taken as that of strips side by
side, each as deep as it lies (a Winkler bed): of a thin layer that is right, of a deep one too
little, since there the strips carry one another. The least rise is that of the most leaning face.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.expected_press import ExpectedPress

CREEP_SHARE = 0.1
"""Of a force, what a held gel may lose of it: silicone gels lose 5 to 8 %. Whether a stated modulus
is that of a quick press or of a held one is seldom said, so that it is left open both ways."""
DEEPEST_SHARE = 0.5
"""Of the gel's height: deeper, neither the gel nor its simulation has been tried."""
_STRIPS = 40
_GRID = 400


class PressBand:
    """Least and most force of a press.

    Args:
        expected: The stated gel.
        contact_force_n: Force at which depth is called zero [N].
    """

    def __init__(self, expected: ExpectedPress, *, contact_force_n: float) -> None:
        self.expected = expected
        self._depth = np.array(expected.depth_m)
        self._force = np.array(expected.force_n)
        rise_n, way_m = self._force[-1] - self._force[-2], self._depth[-1] - self._depth[-2]
        self._end_slope = rise_n / way_m
        self._grid = np.linspace(0.0, max(self._depth[-1], expected.gel_height_m), _GRID)
        self._leaning = self._strips(self._grid)
        # Where the force sensor calls a soft gel touched.
        self._begin_m = float(np.interp(contact_force_n / expected.low, self._force, self._depth))

    @property
    def deepest_m(self) -> float:
        """Depth below contact that no target justifies [m]."""
        return DEEPEST_SHARE * self.expected.gel_height_m

    def bounds(self, points: Sequence[tuple[float, float]], depth_m: float) -> tuple[float, float]:
        """Return between which forces a press lies [N] that was felt at shallower points before.

        Args:
            points: Depths below contact [m] and the force at each [N], at least one.
            depth_m: Depth below contact now [m].
        """
        return self.least(points, depth_m), self.most(points, depth_m)

    def least(self, points: Sequence[tuple[float, float]], depth_m: float) -> float:
        """Return the lower of ``bounds`` [N]."""
        at_m, felt_n = np.array(points).T
        nearer_m = np.maximum(depth_m - self.expected.depth_error_m, at_m)
        rise_n = self._lean_force(nearer_m) - self._lean_force(at_m)
        return (1.0 - CREEP_SHARE) * float((felt_n + self.expected.low * rise_n).max())

    def most(self, points: Sequence[tuple[float, float]], depth_m: float) -> float:
        """Return the upper of ``bounds`` [N]."""
        at_m, felt_n = np.array(points).T
        further_m = np.maximum(depth_m, at_m) + self.expected.depth_error_m
        rise_n = self._straight(further_m + self._begin_m) - self._straight(at_m + self._begin_m)
        return float((felt_n + (1.0 + CREEP_SHARE) * self.expected.high * rise_n).min())

    def depth_bound(self, force_n: float) -> float:
        """Return how deep below contact a force may lie [m]: in the softest, most leaning gel."""
        needed_n = force_n / (self.expected.low * (1.0 - CREEP_SHARE))
        if needed_n >= self._leaning[-1]:
            return self.deepest_m
        depth_m = float(np.interp(needed_n, self._leaning, self._grid))
        return min(depth_m + self.expected.depth_error_m, self.deepest_m)

    def _lean_force(self, depth_m: FloatArray) -> FloatArray:
        return np.asarray(np.interp(depth_m, self._grid, self._leaning))

    def _straight(self, depth_m: FloatArray) -> FloatArray:
        """Return the curve's force [N]; beyond its end it goes on as steep as there."""
        beyond = np.maximum(depth_m - self._depth[-1], 0.0)
        return np.asarray(np.interp(depth_m, self._depth, self._force) + self._end_slope * beyond)

    def _strips(self, depth_m: FloatArray) -> FloatArray:
        """Return the force of a face that leans by ``lean_m`` [N], over strips of a disc."""
        place = (np.arange(_STRIPS) + 0.5) / _STRIPS * 2.0 - 1.0
        width = np.sqrt(1.0 - place**2)
        behind = self.expected.lean_m * (1.0 - place)
        forces = self._straight(np.maximum(depth_m[:, None] - behind, 0.0))
        return np.asarray(forces @ (width / width.sum()))
