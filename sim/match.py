"""The displacement search: move the indenter until the simulated F_z agrees with a given one.

Each guess is a Newton step in depth with the tangent's dF_z/d(depth), kept inside the bracket that
the evaluations so far have given, and starts from the nearest equilibrium below it. One loading
path serves all the forces of a run, in ascending order.
"""

from __future__ import annotations

from dataclasses import dataclass

from sim.loading import LoadingPath, PathPoint
from tacauchy_rig.errors import ConvergenceError

_EVALUATIONS_MAX = 40


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceMatch:
    """Result of a search.

    Attributes:
        point: The accepted equilibrium.
        history: (depth [m], F_z [N]) of every evaluation, in order.
        newton_iterations: Factorisations spent.
    """

    point: PathPoint
    history: tuple[tuple[float, float], ...]
    newton_iterations: int


def find_force(
    path: LoadingPath,
    force_n: float,
    *,
    tolerance_n: float,
    step_max_m: float = 0.25e-3,
) -> ForceMatch:
    """Search for the depth at which F_z equals ``force_n`` within ``tolerance_n``.

    Args:
        step_max_m: No guess moves the indenter further than this [m].

    Raises:
        ConvergenceError: The force was not reached.
    """
    before = path.counts.newton_iterations
    point = path.last or path.advance(step_max_m)
    history = [(point.depth_m, float(point.force_n[2]))]
    low: PathPoint | None = None
    high: PathPoint | None = None
    for _ in range(_EVALUATIONS_MAX):
        missing = force_n - float(point.force_n[2])
        if abs(missing) <= tolerance_n:
            return ForceMatch(
                point=point,
                history=tuple(history),
                newton_iterations=path.counts.newton_iterations - before,
            )
        low, high = (point, high) if missing > 0.0 else (low, point)
        depth = _next_depth(point, missing, low, high, step_max_m)
        point = path.advance(depth, start=point)
        history.append((point.depth_m, float(point.force_n[2])))
    raise ConvergenceError(
        f"F_z = {force_n:.4f} N was not met within {tolerance_n:g} N after {_EVALUATIONS_MAX} "
        f"evaluations; the nearest was {history[-1][1]:.4f} N at {history[-1][0] * 1e3:.4f} mm",
        remedy="loosen the force tolerance, or check the indenter's position over the pad",
    )


def _next_depth(
    point: PathPoint,
    missing_n: float,
    low: PathPoint | None,
    high: PathPoint | None,
    step_max_m: float,
) -> float:
    stiffness = max(point.stiffness_n_m, 1e-30)
    step = min(max(missing_n / stiffness, -step_max_m), step_max_m)
    depth = point.depth_m + step
    if low is not None and high is not None and not low.depth_m < depth < high.depth_m:
        depth = 0.5 * (low.depth_m + high.depth_m)
    return depth
