"""Force over depth of one indenter in one gel, as the simulator gives it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from tacauchy_rig.core.arrays import FloatArray

_SAME_DEPTH_M = 1e-9
_BEYOND_SHARE = 0.25
"""Of the deepest simulated press: so far its last chord is followed. A gel softer than stated is
pressed deeper than that; a ball's force, which bends most, is 2 % off there."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ForceDepthCurve:
    """A pressing force over the depth below first touch."""

    depth_m: FloatArray  # rising depths [m], shape [n]
    force_n: FloatArray  # force at each [N], shape [n]

    @classmethod
    def merged(cls, histories: Sequence[Sequence[tuple[float, float]]]) -> Self | None:
        """Merge the evaluations of all trials' searches into one curve from first touch on.

        The trials share one model, so every (depth [m], force [N]) lies on the same curve.

        Returns:
            None when there is no evaluation; else its first point is zero.
        """
        points = np.array(
            sorted((d, f) for history in histories for d, f in history if d > 0.0), dtype=np.float64
        ).reshape(-1, 2)
        if not len(points):
            return None
        apart = np.diff(points[:, 0], prepend=0.0) > _SAME_DEPTH_M  # trials pass the same depths
        depth_m, force_n = np.concatenate([[[0.0, 0.0]], points[apart]]).T
        return cls(depth_m=depth_m, force_n=force_n)

    def force_at(self, depth_m: float) -> float | None:
        """Interpolate the force [N] at a depth [m].

        Returns:
            None where nothing was simulated: above the first depth, or more than a quarter below
            the last; up to there the curve goes on as straight as over its last quarter.
        """
        depths, forces = self.depth_m, self.force_n
        if len(depths) < 2 or not depths[0] <= depth_m <= (1.0 + _BEYOND_SHARE) * depths[-1]:
            return None
        if depth_m <= depths[-1]:
            return float(np.interp(depth_m, depths, forces))
        # Not from the last two points: a nanometre apart they show the solver's tolerance.
        before_m = 0.75 * depths[-1]
        slope = (forces[-1] - np.interp(before_m, depths, forces)) / (depths[-1] - before_m)
        return float(forces[-1] + slope * (depth_m - depths[-1]))

    def depth_at(self, force_n: float) -> float | None:
        """Return the depth [m] at which a force [N] is first reached; None above all forces."""
        reached = np.flatnonzero(self.force_n >= force_n)
        if len(self.force_n) < 2 or not len(reached):
            return None
        last = max(int(reached[0]), 1)
        (d0, d1), (f0, f1) = self.depth_m[last - 1 : last + 1], self.force_n[last - 1 : last + 1]
        return float(d0 + (d1 - d0) * (force_n - f0) / (f1 - f0)) if f1 > f0 else float(d0)

    def scaled(self, factor: float) -> Self:
        """Return the curve of a gel so many times as stiff."""
        return replace(self, force_n=factor * self.force_n)
