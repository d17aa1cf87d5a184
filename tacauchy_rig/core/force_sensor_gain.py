"""Gain of the force sensor over a run, estimated from sources independent of it.

The unknown is the gain of the sensor in each trial: its reading over the true force, as a natural
logarithm, so that 0 is right. Four sources tell of it, each with a stated uncertainty:

- the arm's own estimate at each dwell, with a gain and an offset that all trials share;
- the force-depth curves of the trials: one gel gave all of them, so they differ by gain, zero and
  depth of contact alone;
- the stated gel at the depth of each dwell, with a stiffness that all trials share;
- a known weight that was hung on the sensor after the last trial.

Generalised least squares (A. C. Aitken, "On least squares and linear combination of observations",
1936) joins them.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.config.settings import RobotModel
from tacauchy_rig.core.known_weight import SCALE_SHARE, ForceCheck
from tacauchy_rig.core.run import Criterion, TrialRecord

FORCE_HISTORY = "force_history"
FORCE_LIMITS = frozenset(
    f"witness.{name}" for name in ("arm", "gel", "depth", "camera", "noise", "old-data", "sideways")
)
"""Limits of the guard that a force sensor passes which is faulty."""
WEIGH_REMEDY = (
    "hang a known weight on the force sensor: `tacauchy-rig resume RUN --check-weight 200g` checks "
    "it and presses again what it measured"
)
ARM_WINDOW_S = 0.2
"""Of a mean of the arm's estimate that is compared at once."""
ARM_ZERO_S = 0.9
"""Of the mean that is its zero: the noise of a zero is in all that is felt until the next."""
DEVIATIONS = 3.0
"""Standard deviations beyond the tolerance ``SCALE_SHARE`` at which a gain is called wrong."""
COVERAGE = 2.0
CREEP_SHARE = 0.1
"""Of a force, what a held gel may lose of it: silicone gels lose 5 to 8 %. Whether a stated modulus
is that of a quick press or of a held one is seldom said, so that it is left open both ways."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmAccuracy:
    """Standard uncertainties of an arm: of its force averaged over a dwell, and of its heights."""

    gain: float  # of its estimate, the same in all trials [1]
    # The same in all trials [N]: joint friction that the direction of motion decides
    offset_n: float
    scatter_n: float  # from trial to trial [N]: noise and drift
    depth_share: float  # of the way from contact, from trial to trial [1]
    contact_m: float  # of the height of contact, from trial to trial [m]


ARM_ACCURACY = {
    RobotModel.E_SERIES: ArmAccuracy(
        gain=0.02, offset_n=0.05, scatter_n=0.06, depth_share=0.02, contact_m=10e-6
    ),
    RobotModel.CB3: ArmAccuracy(
        gain=0.05, offset_n=2.5, scatter_n=0.6, depth_share=0.03, contact_m=15e-6
    ),
}
"""Of no arm that we measured: docs/explanation/witness.md."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialForce:
    """What the sources say of the sensor in one trial."""

    index: int  # of the trial
    gain: float  # reading over true force [1]
    gain_uncertainty: float  # standard uncertainty of it [1]

    @property
    def uncertainty(self) -> float:
        """How far the true force may be from the reading, as a share of it [1]; 95 %."""
        return abs(1.0 - self.gain) + COVERAGE * self.gain_uncertainty


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceHistory:
    """Judgement of a sensor over the trials of a run."""

    trials: tuple[TrialForce, ...]  # in the order in which they were pressed
    sources: tuple[str, ...]  # what was compared, in words
    fault: str = ""  # what is wrong, in words; empty where nothing was found
    # By how many times its limit the worst quantity is off [1]; above 1 is a fault
    excess: float = 0.0

    @property
    def uncertainty(self) -> float:
        """How far the least certain force may be from the reading, as a share of it [1]; 95 %."""
        return max((trial.uncertainty for trial in self.trials), default=math.inf)

    def criterion(self) -> Criterion:
        """Return whether the force sensor agrees with all that was compared with it."""
        return Criterion(
            name=FORCE_HISTORY,
            measured=self.excess,
            passed=not self.fault,
            limit=f"at most 1 of what {' and '.join(self.sources)} allow",
            unit="",
            remedy=f"{self.fault}: {WEIGH_REMEDY}",
        )


def judge_forces(
    records: Sequence[TrialRecord], model: RobotModel, *, weighed: ForceCheck | None = None
) -> ForceHistory:
    """Judge the force sensor by all trials that were pressed with it.

    Args:
        records: Trials with a measured force, in the order in which they were pressed.
        weighed: The check by a known weight after the last of them.
    """
    records = [r for r in records if r.force_measured_n is not None and r.force_measured_n > 0.0]
    if not records:
        return ForceHistory(trials=(), sources=())
    accuracy = ARM_ACCURACY[model]
    tried = (
        _arm_source(records, accuracy),
        _curve_source(records, accuracy),
        _gel_source(records),
        None if weighed is None else _weight_source(len(records), weighed),
    )
    found = [source for source in tried if source is not None]
    gain, covariance, misfit = _join(found, len(records))
    trials = tuple(
        TrialForce(
            index=record.index,
            gain=math.exp(gain[k]),
            gain_uncertainty=math.exp(gain[k]) * math.sqrt(covariance[k, k]),
        )
        for k, record in enumerate(records)
    )
    excess, fault = max(
        _wrong_gain(trials),
        _changed_gain(trials, gain, covariance),
        _disagreement(found, misfit, len(records)),
        _creep(records),
    )
    return ForceHistory(
        trials=trials,
        sources=tuple(source.name for source in found),
        fault=fault if excess > 1.0 else "",
        excess=excess,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Source:
    """Observations of the logarithms of the gains."""

    name: str
    observed: FloatArray  # shape (m,)
    design: FloatArray  # what a gain changes of each, shape (m, trials)
    covariance: FloatArray  # shape (m, m)


def _arm_source(records: Sequence[TrialRecord], accuracy: ArmAccuracy) -> _Source | None:
    felt = [k for k, record in enumerate(records) if record.arm_force_n is not None]
    if not felt:
        return None
    cell_n = np.array([records[k].force_measured_n for k in felt], dtype=float)
    arm_n = np.array([records[k].arm_force_n for k in felt], dtype=float)
    # A coarse arm may feel nothing: its uncertainty says the same then.
    arm_n = np.maximum(arm_n, 0.1 * cell_n)
    true_n = np.maximum(cell_n, arm_n)
    covariance = (
        accuracy.gain**2
        + accuracy.offset_n**2 / np.outer(true_n, true_n)
        + np.diag((accuracy.scatter_n / true_n) ** 2)
    )
    return _Source(
        name="the arm's estimate",
        observed=np.log(cell_n / arm_n),
        design=np.eye(len(records))[felt],
        covariance=covariance,
    )


_STIFFNESS_SD = 0.05
"""Of the stated gel from trial to trial [1]: creep and depth."""


def _gel_source(records: Sequence[TrialRecord]) -> _Source | None:
    expected = [record.force_expected_n or (0.0, 0.0) for record in records]
    known = [k for k, (least_n, _) in enumerate(expected) if least_n > 0.0]
    if not known:
        return None
    least_n, most_n = np.array([expected[k] for k in known]).T
    cell_n = np.array([records[k].force_measured_n for k in known])
    middle_n = 0.5 * (least_n + most_n)
    # The bounds hold 95 %: half of their distance is two standard deviations. What the most certain
    # trial leaves open is the stiffness, the same in all of them.
    deviation = 0.25 * (most_n - least_n) / middle_n
    common = float(deviation.min())
    return _Source(
        name="the stated gel",
        observed=np.log(cell_n / middle_n),
        design=np.eye(len(records))[known],
        covariance=common**2 + np.diag(deviation**2 - common**2 + _STIFFNESS_SD**2),
    )


_WEIGHT_SD = 0.01
"""Of the gain between the last trial and the weight [1]."""


def _weight_source(count: int, check: ForceCheck) -> _Source:
    uncertainty = check.tolerance_n / check.weight.force_n - SCALE_SHARE
    return _Source(
        name=f"the weight of {check.weight} after the last trial",
        observed=np.array([math.log(max(check.ratio, 0.05))]),
        design=np.eye(count)[-1:],
        covariance=np.array([[_WEIGHT_SD**2 + uncertainty**2]]),
    )


def _join(sources: Sequence[_Source], count: int) -> tuple[FloatArray, FloatArray, float]:
    """Return logarithms of the gains, their covariance, and the weighted square of what is left.

    Where nothing tells of a gain it may be anything: a prior of three e-folds.
    """
    information, told, square = np.eye(count) / 9.0, np.zeros(count), 0.0
    for source in sources:
        weight = np.linalg.inv(source.covariance)
        information += source.design.T @ weight @ source.design
        told += source.design.T @ weight @ source.observed
        square += float(source.observed @ weight @ source.observed)
    covariance: FloatArray = np.asarray(np.linalg.inv(information), dtype=float)
    gain = covariance @ told
    return gain, covariance, max(square - float(told @ gain), 0.0)


Finding = tuple[float, str]
"""By how many times its limit something is off, and what it is, in words."""


def _wrong_gain(trials: Sequence[TrialForce]) -> Finding:
    def off(trial: TrialForce) -> float:
        share = trial.gain_uncertainty / trial.gain
        return abs(math.log(trial.gain)) / (SCALE_SHARE + DEVIATIONS * share)

    worst = max(trials, key=off)
    return off(worst), (
        f"in trial {worst.index} the force sensor read {worst.gain:.2f} +- "
        f"{COVERAGE * worst.gain_uncertainty:.2f} times the true force"
    )


def _changed_gain(
    trials: Sequence[TrialForce], gain: FloatArray, covariance: FloatArray
) -> Finding:
    change = gain[:, None] - gain[None, :]
    variance = np.diag(covariance)
    deviation = np.sqrt(np.maximum(variance[:, None] + variance[None, :] - 2.0 * covariance, 0.0))
    off = np.abs(change) / (SCALE_SHARE + DEVIATIONS * deviation)
    before, after = sorted(divmod(int(off.argmax()), len(trials)))
    return float(off.max()), (
        f"the force sensor's gain changed by {math.expm1(change[after, before]):+.0%} +- "
        f"{COVERAGE * deviation[after, before]:.0%} from trial {trials[before].index} to "
        f"trial {trials[after].index}"
    )


_MISFIT_DEVIATIONS = 5.0


def _disagreement(sources: Sequence[_Source], misfit: float, count: int) -> Finding:
    """Compare the square of what is left with a chi-squared distribution, as a normal one.

    Wilson and Hilferty, "The distribution of chi-square", 1931.
    """
    degrees = sum(len(source.observed) for source in sources) - count
    if degrees <= 0:
        return 0.0, ""
    spread = 2.0 / (9.0 * degrees)
    score = ((misfit / degrees) ** (1.0 / 3.0) - (1.0 - spread)) / math.sqrt(spread)
    names = ", ".join(source.name for source in sources)
    return score / _MISFIT_DEVIATIONS, f"these sources disagree on the force: {names}"


_HELD_M = 3e-6
"""Standard uncertainty of the way that a held tip goes [m]."""


def _creep(records: Sequence[TrialRecord]) -> Finding:
    """Judge how much deeper a press went at a constant reading: a gel gives way by so much only."""
    ways = [way for record in records if (way := _held_way(record)) is not None]
    if not ways:
        return 0.0, ""
    shares, deviations = zip(*ways, strict=True)
    weight = 1.0 / np.square(deviations)
    mean = float(weight @ shares / weight.sum())
    limit = CREEP_SHARE + DEVIATIONS / math.sqrt(weight.sum())
    return mean / limit, (
        f"while the reading was held constant the presses went deeper by {mean:.0%} of the force, "
        f"a gel by {CREEP_SHARE:.0%} at most: the force sensor loses force under load"
    )


def _held_way(record: TrialRecord) -> tuple[float, float] | None:
    """Return the force of the way from reaching the target to the dwell, and its uncertainty."""
    depth_m, force_n = np.array(record.press_depth_m), np.array(record.press_force_n)
    if len(depth_m) < _MIN_POINTS or record.depth_measured_m is None:
        return None
    near = depth_m >= depth_m[-1] - 0.1e-3
    if near.sum() < 3:
        return None
    stiffness_n_m = float(np.polyfit(depth_m[near], force_n[near], 1)[0])
    measured_n = record.force_measured_n or math.nan
    way_n = stiffness_n_m * (record.depth_measured_m - float(depth_m[-1]))
    share = (way_n - (measured_n - float(force_n[-1]))) / measured_n
    return share, stiffness_n_m * _HELD_M / measured_n + 0.01


_MIN_POINTS = 4
_NODE_M = 25e-6
_POINT_SD_N, _POINT_SHARE = 0.01, 0.01
"""Of a point of a curve: noise averaged over 50 ms; relaxation where a press slows down."""
_ZERO_SD_N = 0.03
_BEND_SD_N = 0.05
_ROUNDS = 5


def _fit_curves(
    records: Sequence[TrialRecord], accuracy: ArmAccuracy
) -> tuple[FloatArray, FloatArray]:
    """Fit one force-depth curve to all presses, and gain, zero and contact of each.

    Gauss-Newton on force = zero + gain * curve(depth + shift), with the curve linear between nodes.

    Returns:
        Logarithms of the gains against that of the first, which is 0, and their covariance.
    """
    count = len(records)
    depth_m = np.concatenate([record.press_depth_m for record in records])
    force_n = np.concatenate([record.press_force_n for record in records])
    of_press = np.repeat(np.eye(count), [len(record.press_depth_m) for record in records], axis=0)
    nodes = math.ceil((depth_m.max() + 0.1e-3) / _NODE_M) + 3
    start_m = -2.0 * _NODE_M
    grid_m = start_m + _NODE_M * np.arange(nodes)
    order = np.argsort(depth_m)
    curve = np.interp(grid_m, depth_m[order], force_n[order])
    gain, zero_n, shift_m = np.zeros((3, count))
    weight = 1.0 / np.hypot(_POINT_SD_N, _POINT_SHARE * force_n)[:, None]
    certain = np.ones(count)
    own = np.concatenate([certain, certain / _ZERO_SD_N, certain / accuracy.contact_m])
    own[0] = 1e6  # the first gain is the reference
    bends = np.diff(np.eye(nodes), n=2, axis=0) / _BEND_SD_N
    priors = np.vstack(
        [np.eye(nodes + 3 * count)[nodes:] * own[:, None], np.pad(bends, ((0, 0), (0, 3 * count)))]
    )
    for _ in range(_ROUNDS):
        place = np.clip((depth_m + of_press @ shift_m - start_m) / _NODE_M, 0.0, nodes - 1.001)
        near = np.maximum(1.0 - abs(place[:, None] - np.arange(nodes)), 0.0)
        slope = (np.diff(curve) / _NODE_M)[place.astype(int)]
        level, factor = near @ curve, np.exp(of_press @ gain)[:, None]
        rows = np.hstack(
            [
                factor * near,
                factor * level[:, None] * of_press,
                of_press,
                factor * slope[:, None] * of_press,
            ]
        )
        left_n = force_n - of_press @ zero_n - factor[:, 0] * level
        state = np.concatenate([curve, gain, zero_n, shift_m])
        matrix = np.vstack([rows * weight, priors])
        aim = np.concatenate([left_n * weight[:, 0], -priors @ state])
        normal = matrix.T @ matrix
        scale = 1.0 / np.sqrt(np.diag(normal))  # units differ by 1e6
        inverse = np.linalg.inv(normal * np.outer(scale, scale)) * np.outer(scale, scale)
        state = state + inverse @ (matrix.T @ aim)
        curve, (gain, zero_n, shift_m) = state[:nodes], state[nodes:].reshape(3, count)
        gain = np.clip(gain, -2.0, 2.0)
    gains = slice(nodes, nodes + count)
    return gain, inverse[gains, gains]


def _curve_source(records: Sequence[TrialRecord], accuracy: ArmAccuracy) -> _Source | None:
    """Return the gains of later presses against the first, at the dwell.

    What a reading lost while it was held adds to what its curve tells.
    """
    of = [k for k, record in enumerate(records) if len(record.press_depth_m) >= _MIN_POINTS]
    if len(of) < 2:
        return None
    gain, covariance = _fit_curves([records[k] for k in of], accuracy)
    held = [_held_way(records[k]) or (0.0, CREEP_SHARE) for k in of]
    lost = np.array([share for share, _ in held])
    # Each press has errors of its own, the first as well: they are in every difference.
    own = np.diag([accuracy.depth_share**2 + deviation**2 for _, deviation in held])
    differ = np.eye(len(of))[1:]
    differ[:, 0] = -1.0
    return _Source(
        name="the force-depth curves of the trials",
        observed=differ @ (gain - lost),
        design=differ @ np.eye(len(records))[of],
        covariance=differ @ (covariance + own) @ differ.T,
    )
