"""How far a tool leans, as the moments of a run tell.

A face that leans by l presses harder on its lower side: its moment about the tip is K(F) l, K from
the simulator. A tool that comes down beside the axis of the cell by an arm a has F a besides, and
so has cross talk of F_z. Presses of several forces tell them apart, since K hardly grows with F.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacauchy_rig.core.arrays import FloatArray

TRIALS_MIN = 3
"""Two presses are met by any lean and arm together."""
STIFFNESS_UNCERTAINTY = 0.1
"""Of K, relative: what its mesh, the gel's height and Poisson's ratio leave uncertain of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeanFit:
    """What moments tell of a tool.

    Attributes:
        lean_rad: Of its axis towards x and y, shape [2] [rad].
        uncertainty_rad: Standard uncertainty of each, shape [2].
        arm_m: From the point that moments refer to, to where the force acts, shape [2] [m].
    """

    lean_rad: FloatArray
    uncertainty_rad: FloatArray
    arm_m: FloatArray


def fit_lean(
    forces_n: FloatArray, moments_nm: FloatArray, errors_nm: FloatArray, stiffness_nm: FloatArray
) -> LeanFit:
    """Fit lean and arm along x and along y.

    Args:
        forces_n: Pressing forces of at least three trials, shape [trial_count].
        moments_nm: On the tool about x and y, base frame, shape [trial_count, 2].
        errors_nm: Their standard errors, likewise.
        stiffness_nm: Moment against a lean of one radian at each force, shape [trial_count].
    """
    columns = np.stack([stiffness_nm, forces_n], axis=1)
    # Positive along x and y: a force at +x turns the tool about -y, one at +y about +x.
    seen = np.stack([-moments_nm[:, 1], moments_nm[:, 0]], axis=1)
    errors = errors_nm[:, ::-1]
    found, uncertainty = [], []
    for values, error in zip(seen.T, errors.T, strict=True):
        weighted, target = columns / error[:, None], values / error
        solution, *_ = np.linalg.lstsq(weighted, target, rcond=None)
        # What scatters more than its samples say is that uncertain; what scatters less, by chance.
        misfit = float(np.sum((weighted @ solution - target) ** 2)) / (len(values) - 2)
        variance = np.linalg.inv(weighted.T @ weighted)[0, 0] * max(1.0, misfit)
        found.append(solution)
        uncertainty.append(np.hypot(np.sqrt(variance), STIFFNESS_UNCERTAINTY * solution[0]))
    lean, arm = np.array(found).T
    return LeanFit(lean_rad=lean, uncertainty_rad=np.array(uncertainty), arm_m=arm)
