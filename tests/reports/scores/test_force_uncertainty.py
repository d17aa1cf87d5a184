"""Force-matched and force-predicted are different numbers with a stated uncertainty."""

import math
from dataclasses import replace

import numpy as np
import pytest

from reports.evidence.evidence_types import RunEvidence
from reports.scores.force_uncertainty import (
    Scatter,
    TermGroup,
    UncertaintyTerm,
    combine,
    compare_force,
    scatter_of,
    uncertainty_budget,
)
from tacauchy_rig.core.config.settings import Stated
from tacauchy_rig.core.simulated import ForceDepthCurve, ForceInput
from tests.made_model import made_model


def test_depth_counts_from_the_contact_force(evidence: RunEvidence) -> None:
    """A press that calls contact at 0.0707 N is 10 um deep already on a 7.07 kN/m simulator."""
    trial = evidence.trials[2]
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


def _term(name: str, value_n: float | None, freedom: float | None = None) -> UncertaintyTerm:
    return UncertaintyTerm(
        name=name,
        group=TermGroup.INPUTS,
        value_n=value_n,
        basis="made up",
        degrees_of_freedom=freedom,
    )


def test_the_gums_end_gauge() -> None:
    """GUM H.1: 25, 9.7, 2.9 and 16.6 nm come to 32 nm with 16.7 degrees of freedom."""
    values = {"standard": (25.0, 18), "d": (9.7, 25.6), "alpha": (2.9, 50), "theta": (16.6, 2)}
    found = combine([_term(name, value, freedom) for name, (value, freedom) in values.items()])
    assert found.value_n == pytest.approx(32.0, abs=0.5)
    assert found.degrees_of_freedom == pytest.approx(16.7, abs=0.1)
    assert found.largest == "standard"


def test_terms_whose_uncertainty_is_known_have_a_normal_interval() -> None:
    """3 and 4 come to 5; 1.96 times that holds 95 %. Without the larger, 3 is left."""
    found = combine([_term("a", 3.0), _term("b", 4.0), _term("c", None)])
    assert found.value_n == 5.0
    assert found.degrees_of_freedom is None
    assert found.expanded_n == pytest.approx(5.0 * 1.95996, rel=1e-5)
    assert (found.largest, found.without_largest_n) == ("b", 3.0)


def test_one_term_of_few_presses_is_students() -> None:
    """Four degrees of freedom: 2.776 times."""
    found = combine([_term("a", 1.0, 4.0)])
    assert found.expanded_n == pytest.approx(2.7764, rel=1e-4)


def test_nothing_known_is_no_interval() -> None:
    """Neither of unknown terms nor of terms of zero."""
    assert combine([_term("a", None)]) is None
    assert combine([_term("a", 0.0)]) is None
    assert not math.isnan(combine([_term("a", 1.0)]).value_n)  # type: ignore[union-attr]


STATED = {
    name: Stated(value=value, source="made up")
    for name, value in {
        "depth": 20e-6,
        "delay": 0.03,
        "force_scale": 0.01,
        "search_speed": 1e-4,
        "contact_force": 0.05,
    }.items()
}
SCATTER = Scatter(relative=0.002, degrees_of_freedom=4.0, basis="made up")


def _terms(evidence: RunEvidence, **changes: object) -> dict[str, UncertaintyTerm]:
    trial = evidence.trials[2]
    assert trial.record is not None
    record = replace(trial.record, force_rate_n_s=-0.1, force_drift_n=-0.03)
    tilt = ForceInput(name="tilt", basis="tried", depths_m=(1e-4, 5e-4), changes=(0.10, 0.02))
    asked = {"predicted_n": 2.0, "touched_m": 1e-5, "scatter": SCATTER, "stated": STATED, **changes}
    model = made_model(young_uncertainty_relative=0.05, force_inputs=(tilt,))
    budget = uncertainty_budget(replace(trial, record=record), model, **asked)  # type: ignore[arg-type]
    return {term.name: term for term in budget}


def test_terms_by_hand(evidence: RunEvidence) -> None:
    """Shares of 2 N, 1 % of what a cell read, a drift that is uniform, a delay times a rate."""
    trial, found = evidence.trials[2], _terms(evidence)
    assert trial.record.depth_measured_m is not None
    between = np.interp(trial.record.depth_measured_m, (1e-4, 5e-4), (0.10, 0.02))
    wanted = {
        "modulus of the gel": 0.1,
        "tilt": 2.0 * between,
        "calibration of the force cell": 0.01 * (trial.record.force_measured_n or 0.0),
        "drift of the force cell's zero": 0.03 / math.sqrt(3.0),
        "synchrony of force and height": 0.003,
        "repeatability of the press": 0.004,
        "light of the image": 0.0,
    }
    for name, value in wanted.items():
        assert found[name].value_n == pytest.approx(value), name
    assert found["repeatability of the press"].degrees_of_freedom == 4.0
    assert all(term.value_n is not None for term in found.values())


def test_height_of_contact_is_arm_delay_and_half_of_the_touch(evidence: RunEvidence) -> None:
    """20 um of the arm, 3 um of the way in 30 ms, 5 um of 10, on 7.07 kN/m; no tare, no noise."""
    found = _terms(evidence)["height of first contact"]
    assert found.value_n == pytest.approx(7070.0 * math.hypot(20e-6, 3e-6, 5e-6), rel=1e-3)


def test_what_is_not_stated_stays_unknown(evidence: RunEvidence) -> None:
    """Neither heights of the arm, nor a calibration, nor a repeatability is made up."""
    few = scatter_of([(1.0, 1.0, 1.0)] * 2)
    found = _terms(evidence, stated={}, scatter=few)
    unknown = {name for name, term in found.items() if term.value_n is None}
    assert unknown == {
        "height of first contact",
        "calibration of the force cell",
        "synchrony of force and height",
        "repeatability of the press",
    }
    assert all(found[name].basis.startswith("unknown") for name in unknown)


def test_repeats_tell_the_scatter_of_a_press() -> None:
    """Five presses of one force that scatter by 2 %, whatever other forces are off by."""
    off = (0.98, 0.98, 1.0, 1.02, 1.02)
    presses = [(2.0, 2.0 * by, 2.0) for by in off] + [(4.0, 6.0, 4.0)]
    found = scatter_of(presses)
    assert found.degrees_of_freedom == 4.0
    assert found.relative == pytest.approx(float(np.std(off, ddof=1)))


def test_without_repeats_a_line_over_the_force_is_no_scatter() -> None:
    """A ratio that falls with the force is a wrong model, not presses that differ."""
    forces = np.linspace(1.0, 5.0, 6)
    ratios = 1.1 - 0.03 * forces
    line = [(f, f * by, f) for f, by in zip(forces, ratios, strict=True)]
    found = scatter_of(line)
    assert found.degrees_of_freedom == 4.0
    assert found.relative == pytest.approx(0.0, abs=1e-9)
    ratios[3] += 0.02
    assert scatter_of(
        [(f, f * by, f) for f, by in zip(forces, ratios, strict=True)]
    ).relative == pytest.approx(0.02 / 2.0, rel=0.25)
