"""Gel modulus and indenter tilt, fitted to the measured depths, forces and moments of a run."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.run import TrialRecord
from tacauchy_rig.core.simulated import ForceDepthCurve

TRIALS_MIN = 3  # two presses are met by any tilt and lever arm together
STIFFNESS_UNCERTAINTY = 0.1
"""Of K, relative: what its mesh, the gel's height and Poisson's ratio leave uncertain of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TiltFit:
    """The tilt of a tool, fitted to its moments."""

    tilt_rad: FloatArray  # tilt of its axis towards x and y, shape [2] [rad]
    uncertainty_rad: FloatArray  # standard uncertainty of each, shape [2]
    # From the point that moments refer to, to where the force acts, shape [2] [m].
    arm_m: FloatArray


def fit_tilt(
    forces_n: FloatArray, moments_nm: FloatArray, errors_nm: FloatArray, stiffness_nm: FloatArray
) -> TiltFit:
    """Fit tilt and lever arm along x and along y.

    A tilt t of the face presses harder on its lower side: the moment about the tip is K(F) t, with
    K from the simulator. A lever arm a between the sensor axis and the tip adds F a, and so does
    cross talk of F_z. Presses of several forces separate the two because K hardly grows with F.

    Args:
        forces_n: Pressing forces of at least three trials, shape [trial_count].
        moments_nm: On the tool about x and y, base frame, shape [trial_count, 2].
        errors_nm: Their standard errors, likewise.
        stiffness_nm: Restoring moment of a tilt of one radian at each force, shape [trial_count].
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
    tilt, arm = np.array(found).T
    return TiltFit(tilt_rad=tilt, uncertainty_rad=np.array(uncertainty), arm_m=arm)


_TRIALS_MIN = 2
_ROUNDS = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class ModulusFit:
    """What a replay's modulus is to be multiplied by."""

    factor: float  # mean over the trials of measured force over simulated force at measured depth
    factor_deviation: float  # standard deviation of the trials' own factors
    trial_count: int  # trials that had both a depth and a force


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
        ratios_found: list[float] = []
        for records, curve in simulated:
            touched = curve.depth_at(contact_force_n / factor)
            ratios_found += [] if touched is None else _ratios(records, curve, touched)
        if len(ratios_found) < _TRIALS_MIN:
            return None
        ratios = np.array(ratios_found)
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
