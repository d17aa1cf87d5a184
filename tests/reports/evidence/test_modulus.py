"""The simulated curve, and the modulus that a run's own depths and forces tell by it."""

from dataclasses import replace

import numpy as np
import pytest

from reports.comparison.result_types import ValidationReport
from reports.comparison.verdict_sentences import limits_of
from reports.evidence.evidence_types import RunEvidence
from reports.evidence.modulus_and_tilt_fit import fit_modulus, fit_tilt
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.run import Outcome, TrialRecord
from tacauchy_rig.core.simulated import ForceDepthCurve
from tests.made_model import made_model

_STIFFNESS_N_M = 6e3
_CONTACT_N = 0.05
CURVE = ForceDepthCurve(depth_m=np.array([0.0, 1e-4, 2e-4]), force_n=np.array([0.0, 1.0, 3.0]))


def _curve() -> ForceDepthCurve:
    """Return a stiffening press: F = k d (1 + 400 d)."""
    depth = np.linspace(0.0, 1.2e-3, 200)
    return ForceDepthCurve(depth_m=depth, force_n=_force(depth))


def _force(depth_m: FloatArray) -> FloatArray:
    return _STIFFNESS_N_M * depth_m * (1.0 + 400.0 * depth_m)


def _records(depths_m: FloatArray, *, stiffer: float) -> list[TrialRecord]:
    """Return trials on a gel so many times as stiff, their depths from the contact force on."""
    curve = _curve()
    touched = float(np.interp(_CONTACT_N / stiffer, curve.force_n, curve.depth_m))
    return [
        TrialRecord(
            index=index,
            attempt=1,
            outcome=Outcome.PASSED,
            force_target_n=1.0,
            force_measured_n=float(stiffer * _force(depth)),
            depth_measured_m=float(depth - touched),
        )
        for index, depth in enumerate(depths_m, start=1)
    ]


@pytest.mark.parametrize("stiffer", [0.8, 1.0, 1.3])
def test_a_stiffer_gel_is_recognised(stiffer: float) -> None:
    """The factor comes out, though depths count from a force that goes with it too."""
    records = _records(np.array([3e-4, 5e-4, 8e-4]), stiffer=stiffer)
    fit = fit_modulus([(records, _curve())], contact_force_n=_CONTACT_N)
    assert fit.factor == pytest.approx(stiffer, rel=1e-4)
    assert fit.factor_deviation < 1e-3
    assert fit.trial_count == 3


def test_trials_that_disagree_show_it() -> None:
    """Forces 10 % to either side: their mean, and how far they are apart."""
    low, high = (_records(np.array([5e-4]), stiffer=s)[0] for s in (0.9, 1.1))
    fit = fit_modulus([([low, high], _curve())])
    assert fit.factor == pytest.approx(1.0, rel=0.02)
    assert fit.factor_deviation == pytest.approx(0.14, rel=0.1)


def test_one_depth_tells_nothing() -> None:
    """Without a second trial, a curve, or depths on it, there is no factor."""
    records = _records(np.array([3e-4, 5e-4]), stiffer=1.1)
    assert fit_modulus([(records[:1], _curve())]) is None
    assert fit_modulus([(records, None)]) is None
    deep = [replace(record, depth_measured_m=5e-3) for record in records]
    assert fit_modulus([(deep, _curve())]) is None
    unknown = [replace(record, depth_measured_m=None) for record in records]
    assert fit_modulus([(unknown, _curve())]) is None


def test_the_report_says_that_the_gel_was_fitted(
    evidence: RunEvidence, report: ValidationReport
) -> None:
    """How much stiffer, from how many trials; nothing of it where the modulus is the stated one."""
    fitted = made_model(modulus_factor=1.079, modulus_factor_deviation=0.005, modulus_trials=6)
    sentences = " ".join(
        limits_of(report.trials, report.statistics, replace(evidence, model=fitted))
    )
    assert "1.079 times the nominal value" in sentences
    assert "6 of these same presses" in sentences
    assert "the nominal value" not in " ".join(
        limits_of(report.trials, report.statistics, evidence)
    )


def test_force_goes_on_by_a_quarter_of_the_depth() -> None:
    """Between two depths linear, so a little below the last; further off nothing is said."""
    assert CURVE.force_at(1.5e-4) == pytest.approx(2.0)
    assert CURVE.force_at(2.1e-4) == pytest.approx(3.2)
    assert CURVE.force_at(2.5e-4) == pytest.approx(4.0)
    assert CURVE.force_at(2.6e-4) is None
    assert CURVE.force_at(-1e-6) is None
    start = ForceDepthCurve(depth_m=np.zeros(1), force_n=np.zeros(1))
    assert start.force_at(0.0) is None


def test_depth_is_where_a_force_is_first_reached() -> None:
    """Between two depths linear; no depth above the forces that were simulated."""
    assert CURVE.depth_at(2.0) == pytest.approx(1.5e-4)
    assert CURVE.depth_at(3.1) is None


def test_histories_of_all_trials_are_one_curve() -> None:
    """Evaluations are sorted by depth, start at rest, and repeated ones count once."""
    merged = ForceDepthCurve.merged([((2e-4, 3.0), (1e-4, 1.0)), ((1e-4, 1.0),)])
    assert np.array_equal(merged.depth_m, CURVE.depth_m)
    assert np.array_equal(merged.force_n, CURVE.force_n)
    assert ForceDepthCurve.merged([(), ()]) is None


def test_one_depth_counts_once() -> None:
    """Trials that pass one depth, the solver's tolerance apart, leave a curve with a slope."""
    merged = ForceDepthCurve.merged([((1e-4, 1.0), (2e-4, 3.0)), ((1e-4, 1.0 + 1e-9), (2e-4, 3.0))])
    assert np.array_equal(merged.depth_m, [0.0, 1e-4, 2e-4])
    assert np.isfinite(np.gradient(merged.force_n, merged.depth_m)).all()


FORCES = np.array([1.26, 1.95, 2.65, 3.34, 4.04, 4.73])
STIFFNESS = np.array([12.9, 13.5, 13.9, 14.1, 14.4, 14.6]) * 1e-3
LEAN, ARM = np.array([0.012, -0.007]), np.array([2e-4, -3e-4])


def _moments(noise_nm: float = 0.0, seed: int = 0) -> np.ndarray:
    """Return moments about x and y of a tool that leans and comes down beside its axis."""
    along = np.outer(STIFFNESS, LEAN) + np.outer(FORCES, ARM)
    noise = noise_nm * np.random.default_rng(seed).standard_normal((len(FORCES), 2))
    return np.stack([along[:, 1], -along[:, 0]], axis=1) + noise


def test_lean_and_arm_are_told_apart() -> None:
    """Without noise both come back; what is uncertain is the stiffness alone."""
    fit = fit_tilt(FORCES, _moments(), np.full((6, 2), 1e-9), STIFFNESS)
    assert fit.tilt_rad == pytest.approx(LEAN)
    assert fit.arm_m == pytest.approx(ARM)
    assert fit.uncertainty_rad == pytest.approx(0.1 * np.abs(LEAN), rel=1e-3)


def test_the_uncertainty_covers_what_noise_does() -> None:
    """Of 200 runs with noise, about 95 in 100 are within twice the stated uncertainty."""
    noise_nm = 2e-5
    errors = np.full((6, 2), noise_nm)
    fits = [fit_tilt(FORCES, _moments(noise_nm, seed), errors, STIFFNESS) for seed in range(200)]
    off = [np.abs(f.tilt_rad - LEAN) / f.uncertainty_rad for f in fits]
    assert 0.9 < np.mean(np.array(off) < 2.0) <= 1.0
    # The noise's own part, without the stiffness's, is not far too large either.
    assert np.std([f.tilt_rad[1] for f in fits]) > 0.3e-3


def test_an_upright_tool_is_within_its_uncertainty_of_none() -> None:
    """A lean of zero beside a long arm is found as next to nothing."""
    moments = np.stack([FORCES * ARM[1], -FORCES * ARM[0]], axis=1)
    fit = fit_tilt(FORCES, moments, np.full((6, 2), 2e-5), STIFFNESS)
    assert np.all(np.abs(fit.tilt_rad) < fit.uncertainty_rad)
