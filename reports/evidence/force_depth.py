"""The simulator's force over depth, and the modulus that measured depths and forces tell by it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.run import TrialRecord

_SAME_DEPTH_M = 1e-9
_BEYOND_SHARE = 0.25
"""Of the deepest simulated press: so far its last chord is followed. A gel softer than stated is
pressed deeper than that; a ball's force, which bends most, is 2 % off there."""
_TRIALS_MIN = 2
_ROUNDS = 4


def force_at_depth(curve: FloatArray, depth_m: float) -> float | None:
    """Interpolate the simulated force [N] at ``depth_m``.

    Args:
        curve: (depth [m], force [N]), shape [n, 2], sorted by depth.
        depth_m: Depth below first touch [m].

    Returns:
        None where nothing was simulated: above the first depth, or more than a quarter below the
        last; up to there the curve goes on as straight as over its last quarter.
    """
    if len(curve) < 2 or not curve[0, 0] <= depth_m <= (1.0 + _BEYOND_SHARE) * curve[-1, 0]:
        return None
    depths, forces = curve[:, 0], curve[:, 1]
    if depth_m <= depths[-1]:
        return float(np.interp(depth_m, depths, forces))
    # Not from the last two points: a nanometre apart they tell the solver's tolerance.
    before_m = 0.75 * depths[-1]
    slope = (forces[-1] - np.interp(before_m, depths, forces)) / (depths[-1] - before_m)
    return float(forces[-1] + slope * (depth_m - depths[-1]))


def depth_at_force(curve: FloatArray, force_n: float) -> float | None:
    """Interpolate the depth [m] at which the simulator first reaches ``force_n`` [N].

    Args:
        curve: (depth [m], force [N]), shape [n, 2], sorted by depth.
        force_n: Pressing force [N].

    Returns:
        None above the forces that were simulated.
    """
    reached = np.flatnonzero(curve[:, 1] >= force_n)
    if len(curve) < 2 or not len(reached):
        return None
    last = max(int(reached[0]), 1)
    (d0, f0), (d1, f1) = curve[last - 1], curve[last]
    return float(d0 + (d1 - d0) * (force_n - f0) / (f1 - f0)) if f1 > f0 else float(d0)


def merge_histories(histories: Sequence[Sequence[tuple[float, float]]]) -> FloatArray | None:
    """Merge the evaluations of all trials' searches into one curve from first touch on.

    The trials share one model, so every (depth [m], force [N]) lies on the same curve.

    Returns:
        Shape [n, 2], sorted by depth, first row zero; None when there is no evaluation.
    """
    points = np.array(
        sorted((d, f) for history in histories for d, f in history if d > 0.0), dtype=np.float64
    ).reshape(-1, 2)
    if not len(points):
        return None
    apart = np.diff(points[:, 0], prepend=0.0) > _SAME_DEPTH_M  # trials pass the same depths
    return np.concatenate([[[0.0, 0.0]], points[apart]])


@dataclass(frozen=True, slots=True, kw_only=True)
class ModulusFit:
    """What a replay's modulus is to be multiplied by.

    Attributes:
        factor: Mean over the trials of measured force over simulated force at measured depth.
        factor_deviation: Standard deviation of the trials' own factors.
        trial_count: Trials that had both a depth and a force.
    """

    factor: float
    factor_deviation: float
    trial_count: int


def fit_modulus(
    presses: Sequence[tuple[Sequence[TrialRecord], FloatArray | None]],
    *,
    contact_force_n: float = 0.0,
) -> ModulusFit | None:
    """Find by how much stiffer the gel is than the one that curves were simulated with.

    A flat punch cannot tell the modulus from Poisson's ratio: it is the factor at the ratio that
    was simulated.

    Args:
        presses: Trials of one gel, and what was simulated of their indenter at their place:
            (depth [m], force [N]), shape [n, 2], sorted by depth; None where nothing was.
        contact_force_n: Force at which a press called the gel touched [N]; depths count from there.

    Returns:
        None for fewer than two trials whose depth and force are known and on their curve.
    """
    simulated = [(records, curve) for records, curve in presses if curve is not None]
    factor, ratios = 1.0, np.empty(0)
    for _ in range(_ROUNDS):  # how deep the simulator is at the contact force goes with the factor
        told: list[float] = []
        for records, curve in simulated:
            touched = depth_at_force(curve, contact_force_n / factor)
            told += [] if touched is None else _ratios(records, curve, touched)
        if len(told) < _TRIALS_MIN:
            return None
        ratios = np.array(told)
        factor = float(ratios.mean())
    return ModulusFit(
        factor=factor, factor_deviation=float(ratios.std(ddof=1)), trial_count=len(ratios)
    )


def _ratios(records: Sequence[TrialRecord], curve: FloatArray, touched_m: float) -> list[float]:
    found = []
    for record in records:
        if record.depth_measured_m is None or record.force_measured_n is None:
            continue
        simulated = force_at_depth(curve, record.depth_measured_m + touched_m)
        if simulated:
            found.append(record.force_measured_n / simulated)
    return found
