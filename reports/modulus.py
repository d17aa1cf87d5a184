"""The gel's modulus from measured depths and forces: forces are in proportion to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from reports.arrays import FloatArray
from reports.scores.force_agreement import depth_at_force, force_at_depth
from tacauchy_rig.run import TrialRecord

_TRIALS_MIN = 2
_ROUNDS = 4


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
    records: Sequence[TrialRecord], curve: FloatArray | None, *, contact_force_n: float = 0.0
) -> ModulusFit | None:
    """Find by how much stiffer the gel is than the one that a curve was simulated with.

    A flat punch cannot tell the modulus from Poisson's ratio: it is the factor at the ratio that
    was simulated.

    Args:
        records: Trials of one run.
        curve: Simulated (depth [m], force [N]), shape [n, 2], sorted by depth.
        contact_force_n: Force at which a press called the gel touched [N]; depths count from there.

    Returns:
        None for fewer than two trials whose depth and force are known and on the curve.
    """
    if curve is None:
        return None
    factor, ratios = 1.0, np.empty(0)
    for _ in range(_ROUNDS):  # how deep the simulator is at the contact force goes with the factor
        touched = depth_at_force(curve, contact_force_n / factor)
        if touched is None:
            return None
        ratios = np.array(_ratios(records, curve, touched))
        if len(ratios) < _TRIALS_MIN:
            return None
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
