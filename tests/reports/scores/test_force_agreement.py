"""Force-matched and force-predicted are different numbers with a stated uncertainty."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from reports.evidence.evidence import RunEvidence
from reports.scores.force_agreement import TermGroup, compare_force
from tacauchy_rig.core.config.uncertainty import Stated
from tacauchy_rig.core.force_depth import ForceDepthCurve
from tests.made_model import made_model


def test_depth_counts_from_the_contact_force(evidence: RunEvidence) -> None:
    """A press that calls contact at 0.0707 N is 10 um deep already on a 7.07 kN/m simulator."""
    trial = evidence.trials[2]
    assert trial.record is not None
    assert trial.record.depth_measured_m is not None
    stated = {"depth": Stated(value=0.0, source="made")}
    force = compare_force(
        trial, tolerance_n=0.08, model=None, contact_force_n=0.0707, stated=stated
    )
    assert force.touch_depth_m == pytest.approx(1e-5)
    assert force.force_predicted_n == pytest.approx(7070.0 * (trial.record.depth_measured_m + 1e-5))
    height = next(t for t in force.budget if t.name == "height of first contact")
    assert height.value_n == pytest.approx(0.5 * 0.0707, rel=1e-6)


def test_contact_height_ignores_evaluations_at_nearly_one_depth(evidence: RunEvidence) -> None:
    """Two trials that evaluate almost one depth, 0.1 mN apart, leave the uncertainty as it was."""
    trial = evidence.trials[2]
    curve, depth = trial.force_depth_simulated, trial.record.depth_measured_m
    near = [(depth, 7070.0 * depth), (depth + 2e-9, 7070.0 * depth + 1e-4)]
    points = sorted([*zip(curve.depth_m, curve.force_n, strict=True), *near])
    depths_m, forces_n = np.array(points).T
    doubled = ForceDepthCurve(depth_m=depths_m, force_n=forces_n)
    found = [
        next(t for t in force.budget if t.name == "height of first contact").value_n
        for force in (
            compare_force(t, tolerance_n=0.08, model=None, contact_force_n=0.0707)
            for t in (trial, replace(trial, force_depth_simulated=doubled))
        )
    ]
    assert found[1] == pytest.approx(found[0], abs=1e-4)


def test_both_claims_of_a_trial(evidence: RunEvidence) -> None:
    """Matched: 1 % by construction of the made-up trial; predicted: from the measured depth."""
    trial = evidence.trials[3]
    assert trial.record is not None
    assert trial.record.force_measured_n is not None
    assert trial.record.depth_measured_m is not None
    force = compare_force(trial, tolerance_n=0.08, model=None)
    assert force.mismatch_n == pytest.approx(0.01 * trial.record.force_measured_n)
    assert force.force_predicted_n == pytest.approx(
        1.01 * 7000.0 * trial.record.depth_measured_m, rel=1e-9
    )
    assert force.prediction_error_n == pytest.approx(
        force.force_predicted_n - trial.record.force_measured_n
    )


def test_unknown_terms_stay_unknown(evidence: RunEvidence) -> None:
    """Known terms add in squares; unknown ones are named and make the sum a lower bound."""
    force = compare_force(evidence.trials[0], tolerance_n=0.08, model=None)
    known = [t.value_n for t in force.budget if t.value_n is not None]
    assert force.known_uncertainty_n == pytest.approx(math.sqrt(sum(v * v for v in known)))
    assert not force.budget_complete
    assert {t.group for t in force.budget} == set(TermGroup)
    assert all(t.basis for t in force.budget)


def test_stated_modulus_uncertainty_enters(evidence: RunEvidence) -> None:
    """5 % of modulus is 5 % of force."""
    trial = evidence.trials[0]
    assert trial.replay is not None
    model = made_model(young_uncertainty_relative=0.05)
    force = compare_force(trial, tolerance_n=0.08, model=model)
    modulus = next(t for t in force.budget if "modulus" in t.name)
    assert force.force_predicted_n is not None
    assert modulus.value_n == pytest.approx(0.05 * force.force_predicted_n)


def test_missing_replay_says_nothing(evidence: RunEvidence) -> None:
    """Without a replay there is no mismatch, no prediction and no invented uncertainty."""
    trial = replace(evidence.trials[0], replay=None, force_depth_simulated=None)
    force = compare_force(trial, tolerance_n=0.08, model=None)
    assert force.mismatch_n is None
    assert force.prediction_error_n is None
    assert force.budget[0].value_n is None
