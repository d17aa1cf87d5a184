"""Edge lengths around a footprint."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.spatial

from sim.arrays import FloatArray
from sim.mesh.footprint import Footprint


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

    @cached_property
    def _trees(self) -> tuple[scipy.spatial.cKDTree, scipy.spatial.cKDTree]:
        places = self.footprint
        return scipy.spatial.cKDTree(places.edge), scipy.spatial.cKDTree(places.inside)
