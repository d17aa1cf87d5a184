"""What a replay must meet, each criterion on both sides of its limit."""

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest

from reports.comparison.report_criteria import (
    MODULUS,
    MODULUS_TRIALS,
    PREDICTION,
    judge_model,
    judge_modulus,
)
from reports.comparison.result_types import ValidationReport, headline_of
from reports.comparison.run_comparison import compare
from reports.evidence.evidence_types import RunEvidence
from reports.scores.wrong_forces import ForceMargin
from tacauchy_rig.core.run import Criterion
from tests.made_model import made_model


def judged(report: ValidationReport, **changes: object) -> dict[str, Criterion]:
    """Judge the first made-up trial with other findings."""
    trial, evidence = report.trials[0], report.evidence
    findings = {
        "margin": trial.force_margin,
        "contact": trial.contact,
        "corrections": trial.corrections,
        "force": trial.force,
    }
    criteria = judge_model(evidence.trials[0], evidence.thresholds, **(findings | changes))
    return {c.name: c for c in criteria}


@pytest.mark.parametrize(
    ("value", "spread", "met"), [(0.31, 0.1, True), (0.29, 0.1, False), (-0.5, 0.1, False)]
)
def test_margin_counts_in_its_scatter(
    report: ValidationReport, value: float, spread: float, met: bool
) -> None:
    """Three times what noise and repeats change; a wrong force that wins never passes."""
    margin = ForceMargin(value=value, spread=spread, rival="1.9511 N")
    found = judged(report, margin=margin)["force_margin"]
    assert found.passed is met
    assert met or "1.9511 N" in found.remedy


def test_a_margin_of_unknown_scatter_fails(report: ValidationReport) -> None:
    """Nobody knows what noise does to it: not measured, and the remedy says how to."""
    margin = ForceMargin(value=0.9, spread=None, rival="no contact")
    found = judged(report, margin=margin)["force_margin"]
    assert not found.passed
    assert math.isnan(found.measured)
    assert "four frames" in found.remedy


def test_residual_and_offset_have_limits(report: ValidationReport) -> None:
    """Just below and just above; what was not rendered fails."""
    contact, corrections = report.trials[0].contact, report.trials[0].corrections
    assert contact is not None
    assert corrections.pose is not None
    for residual, met in ((0.89, True), (0.91, False)):
        found = judged(report, contact=replace(contact, relative_residual=residual))
        assert found["contact_residual"].passed is met
    for x_mm, met in ((0.059, True), (-0.061, False)):
        pose = replace(corrections.pose, x_mm=x_mm, y_mm=0.0)
        found = judged(report, corrections=replace(corrections, pose=pose))
        assert found["contact_offset"].passed is met
    pose = replace(corrections.pose, x_mm=0.0, y_mm=0.0)
    moved = made_model(found_offset_m=(0.0, 0.061e-3))
    found = judged(report, corrections=replace(corrections, pose=pose), model=moved)
    assert not found["contact_offset"].passed
    nothing = judged(report, contact=None, corrections=None, margin=None)
    missed = {name for name, c in nothing.items() if not c.passed}
    assert missed == {"force_margin", "contact_residual", "contact_offset"}
    assert all(nothing[name].remedy for name in missed)


def test_prediction_must_lie_within_its_uncertainty(report: ValidationReport) -> None:
    """Twice the standard uncertainty, in both directions."""
    force = report.trials[0].force
    for error_n, met in ((0.019, True), (-0.019, True), (0.021, False), (-0.021, False)):
        found = judged(
            report, force=replace(force, prediction_error_n=error_n, known_uncertainty_n=0.01)
        )
        assert found["predicted_force"].passed is met
    assert not judged(report, force=replace(force, prediction_error_n=None))[
        "predicted_force"
    ].passed


@pytest.mark.parametrize(("force_n", "met"), [(0.079, True), (0.081, False), (-0.081, False)])
def test_force_mismatch_limit(evidence: RunEvidence, force_n: float, met: bool) -> None:
    """0.08 N counts in both directions."""
    trial = evidence.trials[0]
    assert trial.replay is not None
    assert trial.record.force_measured_n is not None
    replay = replace(trial.replay, force_simulated_n=trial.record.force_measured_n + force_n)
    changed = compare(replace(evidence, trials=(replace(trial, replay=replay),)))
    found = {c.name: c.passed for c in changed.trials[0].criteria}
    assert found["force_mismatch"] is met


@pytest.mark.parametrize(
    ("factor", "stated", "met"),
    [(1.19, 0.1, True), (1.21, 0.1, False), (0.524, 0.1, False), (1.0, None, False)],
)
def test_a_fitted_modulus_stays_within_what_is_stated(
    evidence: RunEvidence, factor: float, stated: float | None, met: bool
) -> None:
    """Forces halved and replayed make half the modulus: that is no property of the gel."""
    model = made_model(
        modulus_factor=factor,
        modulus_factor_deviation=0.01,
        modulus_trials=6,
        young_uncertainty_relative=stated,
    )
    report = compare(replace(evidence, model=model, trials=evidence.trials[:2]))
    (found, trials) = report.criteria
    assert found.name == "modulus_factor"
    assert found.passed is met
    assert trials.passed
    assert report.passed is met
    assert met or "modulus factor" in report.verdict


def test_a_modulus_of_too_few_trials_fails(evidence: RunEvidence) -> None:
    """Two trials agree by chance."""
    model = made_model(
        modulus_factor=1.0,
        modulus_factor_deviation=0.0,
        modulus_trials=3,
        young_uncertainty_relative=0.1,
    )
    _, trials = judge_modulus(model, evidence.thresholds)
    assert not trials.passed
    assert list(judge_modulus(made_model(), evidence.thresholds)) == []


def _criterion(name: str, measured: float, limit: str) -> Criterion:
    return Criterion(name=name, passed=False, measured=measured, limit=limit, unit="%")


def test_what_was_asked_of_the_worst_is_said() -> None:
    """A predicted force is asked to be within its own uncertainty, which differs."""
    of_run = (_criterion(MODULUS, 3.0, "within 5"), _criterion(MODULUS_TRIALS, 2.0, "3 or more"))
    assert [row.limit for row in headline_of((), of_run)] == ["within 5", "3 or more"]
    trials = [
        SimpleNamespace(criteria=(_criterion(PREDICTION, measured, f"within {limit}"),))
        for measured, limit in ((2.0, 8), (-9.0, 7), (4.0, 6))
    ]
    (row,) = headline_of(trials, ())
    assert (row.worst, row.limit) == (-9.0, "within 7 (of that trial)")
