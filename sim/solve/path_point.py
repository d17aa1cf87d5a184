"""Equilibria on a loading path, and the state that they predict for the next one."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.contact.surface_and_grip import State
from sim.solve.equilibrium import Equilibrium
from tacauchy_rig.core.arrays import FloatArray

# Points that a prediction uses, at most.
_USED = 3
# A parabola that leaves the line by more than this share of the line's motion tells that the path
# is not smooth, and the line counts. It is 0.05 to 0.25 where gel flows evenly, 0.5 to 4 where a
# frictionless rim gathers it in folds: there a parabola led to another branch with half the force.
_BENT = 0.5
# Points nearer to each other than this share of the step say too little.
_APART = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class PathPoint:
    """An equilibrium on a path.

    Attributes:
        force_n: Force on the indenter in the pad's frame [N], shape [3]; +z in compression.
        stiffness_n_m: dF_z / d(depth) since the point before [N/m]; that point's where it was not
            pressed deeper: what slides under a load sinks without a force.
    """

    depth_m: float  # travel below first touch of the unloaded pad [m]
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


@dataclass(slots=True, kw_only=True)
class PathCounts:
    """Work done along a path so far."""

    newton_iterations: int = 0
    increments: int = 0
    wall_s: float = 0.0


def predicted_state(
    points: Sequence[PathPoint], places: Sequence[float], *, at: float, step: float
) -> State:
    """Return the state that polynomials through the nearest points give.

    Args:
        points: Equilibria, the last one to go on from.
        places: Their depths [m] or loads [N]; of the last one it need not be the largest.
        at: Where the state is wanted, in the same unit.
        step: From the last point to there, likewise.
    """
    chosen: list[int] = []
    for k in sorted(range(len(points)), key=lambda k: abs(places[k] - at)):
        apart = [abs(places[k] - places[j]) for j in chosen]
        if min(apart, default=np.inf) > _APART * abs(step) and len(chosen) < _USED:
            chosen.append(k)
    state = points[chosen[0]].state.copy()
    last, found = state.positions, _interpolated(points, places, chosen[:2], at)
    if len(chosen) > 2:
        bent = _interpolated(points, places, chosen, at)
        motion, off = (float(np.abs(each).max()) for each in (found[0] - last, bent[0] - found[0]))
        found = bent if off <= _BENT * motion else found
    state.positions, state.tip = found
    return state


def _interpolated(
    points: Sequence[PathPoint], places: Sequence[float], chosen: Sequence[int], at: float
) -> tuple[FloatArray, FloatArray]:
    """Return positions and tip of Lagrange's polynomial through the chosen points [m]."""
    shares = [
        float(np.prod([(at - places[j]) / (places[k] - places[j]) for j in chosen if j != k]))
        for k in chosen
    ]
    pairs = list(zip(shares, (points[k].state for k in chosen), strict=True))
    positions = np.sum([share * known.positions for share, known in pairs], axis=0)
    return positions, np.sum([share * known.tip for share, known in pairs], axis=0)
