"""A point of a loading path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.arrays import FloatArray
from sim.contact.state import State
from sim.solve.newton import Equilibrium


@dataclass(frozen=True, slots=True, kw_only=True)
class PathPoint:
    """An equilibrium on a path.

    Attributes:
        depth_m: Travel below first touch of the unloaded pad [m].
        force_n: Force on the indenter in the pad's frame [N], shape [3]; +z in compression.
        stiffness_n_m: dF_z / d(depth) by the tangent [N/m].
    """

    depth_m: float
    force_n: FloatArray
    stiffness_n_m: float
    state: State
    equilibrium: Equilibrium

    @property
    def contact_radius_m(self) -> float:
        """How far from the tip the gel is touched [m]."""
        contact = self.equilibrium.contact
        touched = np.any(contact.forces != 0.0, axis=2)
        away = contact.points[touched] - self.state.tip
        return float(np.hypot(away[:, 0], away[:, 1]).max()) if touched.any() else 0.0
