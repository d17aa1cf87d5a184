"""Edge lengths around a footprint, and the mesh of a pad that follows from them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.spatial

from sim.arrays import FloatArray
from sim.background_grid import Background, tetrahedral_grid
from sim.footprint import Footprint
from sim.pad import Pad

_MARGIN_M = 0.2e-3
_COARSE_CELL_M = 2e-3


@dataclass(frozen=True)
class FootprintSizing:
    """Edge lengths around a footprint: fine at its sharp edge, medium inside, coarse away.

    Attributes:
        footprint: Where the pad is touched.
        edge_m: Edge length at the contact's sharp edge [m].
        inside_m: Largest edge length under the contact [m].
        growth: Edge length gained per length of distance from there, plus one.
        coarse_m: Largest edge length [m].
    """

    footprint: Footprint
    edge_m: float
    inside_m: float
    growth: float
    coarse_m: float

    @property
    def slope(self) -> float:
        """Edge length gained per length of distance."""
        return (self.growth - 1.0) / self.growth

    def size_at(self, points: FloatArray) -> FloatArray:
        """Return the target edge length at points [count, 3], both [m]."""
        edge_tree, inside_tree = self._trees
        # Of no points at all the distance is infinite.
        near_edge, _ = edge_tree.query(points)
        near_inside, _ = inside_tree.query(points)
        size = np.minimum(
            self.edge_m + self.slope * near_edge, self.inside_m + self.slope * near_inside
        )
        return np.asarray(np.minimum(size, self.coarse_m))

    def background(self, pad: Pad) -> Background:
        """Return the field on a grid that is as fine as the field where that is fine."""
        high = np.array([*pad.half_extents(), pad.height_m]) + _MARGIN_M
        low = np.array([-high[0], -high[1], -_MARGIN_M])
        axes = [self._axis(low[k], high[k], self.footprint.inside[:, k]) for k in range(3)]
        points, tets = tetrahedral_grid(axes)
        return Background(points=points, tets=tets, edge_m=self.size_at(points))

    def _axis(self, low: float, high: float, fine: FloatArray) -> FloatArray:
        """Return coordinates from low to high, spaced by the field beside the fine stretch."""
        finest = self.edge_m if len(self.footprint.edge) else self.inside_m
        at, places = low, [low]
        start, end = float(fine.min()), float(fine.max())
        while at < high:
            away = max(start - at, at - end, 0.0)
            step = min(finest + self.slope * away, _COARSE_CELL_M)
            # Coming nearer, a step may not jump into the fine stretch.
            at += min(step, max(start - at, finest)) if at < start else step
            places.append(at)
        return np.array(places)

    @cached_property
    def _trees(self) -> tuple[scipy.spatial.cKDTree, scipy.spatial.cKDTree]:
        places = self.footprint
        return scipy.spatial.cKDTree(places.edge), scipy.spatial.cKDTree(places.inside)
