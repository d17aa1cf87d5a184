"""Where the next equilibrium of a path should lie, by the ones nearest to it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim.contact.state import State
from sim.solve.load_steps.path_point import PathPoint

# Points nearer to each other than this share of the way ahead say too little.
_APART = 0.05


def predicted_state(
    points: Sequence[PathPoint],
    places: Sequence[float],
    *,
    at: float,
    step: float,
    count: int = 3,
) -> State:
    """Return the state that polynomials through the nearest points give.

    Args:
        points: Equilibria, the last one to go on from.
        places: Their depths [m] or loads [N]; of the last one it need not be the largest.
        at: Where the state is wanted, in the same unit.
        step: Way from the last point to there, likewise.
        count: Points that are gone by, at most.
    """
    chosen: list[int] = []
    for k in sorted(range(len(points)), key=lambda k: abs(places[k] - at)):
        apart = [abs(places[k] - places[j]) for j in chosen]
        if min(apart, default=np.inf) > _APART * abs(step) and len(chosen) < count:
            chosen.append(k)
    state = points[chosen[0]].state.copy()
    shares = _lagrange([places[k] for k in chosen], at)
    pairs = list(zip(shares, (points[k].state for k in chosen), strict=True))
    state.positions = np.sum([share * known.positions for share, known in pairs], axis=0)
    state.tip = np.sum([share * known.tip for share, known in pairs], axis=0)
    return state


def _lagrange(places: Sequence[float], at: float) -> list[float]:
    """Return the share of every place's value in the value at another."""
    return [
        float(np.prod([(at - other) / (place - other) for other in places if other != place]))
        for place in places
    ]
