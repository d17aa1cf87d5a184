"""The depth at which F_z equals a force: the paper's displacement search (section IV-C).

Each guess is a Newton step in depth with the tangent's dF_z/d(depth), kept inside the bracket that
the evaluations so far have given, and starts from the nearest equilibrium below it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from sim.solve.loading_path import LoadingPath
from sim.solve.path_point import PathPoint
from tacauchy_rig.core.errors import ConvergenceError

_EVALUATIONS_MAX = 40
# Longest step to a guess, in the path's longest steps.
_GUESS_MAX_STEPS = 5.0
# Every so many evaluations the bracket is halved, so that it shrinks for sure.
_HALVED_EVERY = 4
# A stiffness that is none [N/m].
_NO_STIFFNESS_N_M = 1e-30


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceMatch:
    """Where a path came to, and how."""

    point: PathPoint  # the accepted equilibrium
    # (depth [m], F_z [N]) of every evaluation of a search, in order; else of the load steps
    history: tuple[tuple[float, float], ...]
    newton_iterations: int  # spent

    @classmethod
    def of(cls, path: LoadingPath, go: Callable[[], PathPoint]) -> ForceMatch:
        """Go on along a path, and note its load steps."""
        spent, known = path.counts.newton_iterations, len(path.history)
        point = go()
        spent = path.counts.newton_iterations - spent
        return cls(point=point, history=tuple(path.history[known:]), newton_iterations=spent)


def find_force(path: LoadingPath, force_n: float, *, tolerance_n: float) -> ForceMatch:
    """Search for the depth at which F_z equals ``force_n`` within ``tolerance_n``, both [N].

    Raises:
        ConvergenceError: The force was not reached.
    """
    before = path.counts.newton_iterations
    point = path.last or path.advance(path.step_max_m)
    history = [(point.depth_m, _force(point))]
    low: PathPoint | None = None
    high: PathPoint | None = None
    while len(history) <= _EVALUATIONS_MAX:
        missing = force_n - _force(point)
        if abs(missing) <= tolerance_n:
            spent = path.counts.newton_iterations - before
            return ForceMatch(point=point, history=tuple(history), newton_iterations=spent)
        low, high = (point, high) if missing > 0.0 else (low, point)
        longest = _GUESS_MAX_STEPS * path.step_max_m
        step = missing / max(point.stiffness_n_m, _NO_STIFFNESS_N_M)
        depth = point.depth_m + min(max(step, -longest), longest)
        if low is not None and high is not None:
            halves = len(history) % _HALVED_EVERY == 0
            if halves or not low.depth_m < depth < high.depth_m:
                share = 0.5 if halves else (force_n - _force(low)) / (_force(high) - _force(low))
                depth = low.depth_m + share * (high.depth_m - low.depth_m)
        point = path.advance(depth, start=point)
        history.append((point.depth_m, _force(point)))
    depth, nearest = min(history, key=lambda pair: abs(pair[1] - force_n))
    raise ConvergenceError(
        f"F_z = {force_n:.4f} N was not met within {tolerance_n:g} N after {_EVALUATIONS_MAX} "
        f"evaluations; the nearest was {nearest:.4f} N at {depth * 1e3:.4f} mm",
        remedy="loosen the force tolerance, or check the indenter's position over the pad",
    )


def _force(point: PathPoint) -> float:
    return float(point.force_n[2])
