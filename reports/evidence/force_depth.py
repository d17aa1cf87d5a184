"""The modulus that measured depths and forces give by the simulated force over depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tacauchy_rig.core.force_depth import ForceDepthCurve
from tacauchy_rig.core.run import TrialRecord

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
    presses: Sequence[tuple[Sequence[TrialRecord], ForceDepthCurve | None]],
    *,
    contact_force_n: float = 0.0,
) -> ModulusFit | None:
    """Find by how much stiffer the gel is than the one that curves were simulated with.

    A flat punch cannot tell the modulus from Poisson's ratio: it is the factor at the ratio that
    was simulated.

    Args:
        presses: Trials of one gel, and what was simulated of their indenter at their place:
            None where nothing was.
        contact_force_n: Force at which a press called the gel touched [N]; depths count from there.

    Returns:
        None for fewer than two trials whose depth and force are known and on their curve.
    """
    simulated = [(records, curve) for records, curve in presses if curve is not None]
    factor, ratios = 1.0, np.empty(0)
    for _ in range(_ROUNDS):  # how deep the simulator is at the contact force goes with the factor
        told: list[float] = []
        for records, curve in simulated:
            touched = curve.depth_at(contact_force_n / factor)
            told += [] if touched is None else _ratios(records, curve, touched)
        if len(told) < _TRIALS_MIN:
            return None
        ratios = np.array(told)
        factor = float(ratios.mean())
    return ModulusFit(
        factor=factor, factor_deviation=float(ratios.std(ddof=1)), trial_count=len(ratios)
    )


def _ratios(
    records: Sequence[TrialRecord], curve: ForceDepthCurve, touched_m: float
) -> list[float]:
    found = []
    for record in records:
        if record.depth_measured_m is None or record.force_measured_n is None:
            continue
        simulated = curve.force_at(record.depth_measured_m + touched_m)
        if simulated:
            found.append(record.force_measured_n / simulated)
    return found
