"""Equilibria on a loading path, and the state that they predict for the next one."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.contact.surface_and_grip import State
from sim.solve.equilibrium import Equilibrium
from tacauchy_rig.core.arrays import FloatArray

# Points nearer to each other than this share of the step say too little.
_APART = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class PathPoint:
    """An equilibrium on a path."""

    depth_m: float  # travel below first touch of the unloaded pad [m]
    force_n: FloatArray  # on the indenter in the pad's frame [N], shape [3]; +z in compression
    # dF_z / d(depth) since the point before [N/m]; that point's where it was not pressed deeper:
    # what slides under a load sinks without a force
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


@dataclass(slots=True, kw_only=True)
class PathCounts:
    """Work done along a path so far."""

    newton_iterations: int = 0
    increments: int = 0
    wall_s: float = 0.0


def predicted_state(
    points: Sequence[PathPoint], places: Sequence[float], *, at: float, step: float
) -> State:
    """Return the state that the line through the nearest ones gives.

    Args:
        points: Equilibria, the last one to go on from.
        places: Their depths [m] or loads [N]; of the last one it need not be the largest.
        at: Where the state is wanted, in the same unit.
        step: From the last point to there, likewise.
    """
    nearest, *others = sorted(range(len(points)), key=lambda k: abs(places[k] - at))
    state = points[nearest].state.copy()
    for k in others:
        apart = places[nearest] - places[k]
        if abs(apart) > _APART * abs(step):
            share = (at - places[nearest]) / apart
            state.positions += share * (state.positions - points[k].state.positions)
            state.tip += share * (state.tip - points[k].state.tip)
            break
    return state
