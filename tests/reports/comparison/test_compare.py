"""The verdict, its sentences and its criteria."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from reports.comparison.compare import compare
from reports.comparison.criteria import judge_trial
from reports.comparison.results import ValidationReport
from reports.evidence.evidence import RunEvidence, Thresholds
from reports.scores.metrics import ImageScores, Metric
from tacauchy_rig.force_check import ForceCheck, Weight, judge_weight
from tacauchy_rig.run import Tare

SCORES = ImageScores(ssim=0.9, ncc=0.9, histogram_correlation=0.9, psnr_db=30.0, mse=60.0)
LIMITS = Thresholds(max_force_mismatch_n=0.08, ssim=0.5)


def test_good_run_passes(report: ValidationReport) -> None:
    """Six passing trials pass, and the sentence says on what."""
    assert report.passed
    assert report.verdict.startswith("Passed: all 6 presses on emulated devices")
    assert "0.08 N" in report.verdict


def test_reading_names_the_floor(report: ValidationReport) -> None:
    """The plain text says what the no-contact frame scores."""
    floor = report.statistics.no_contact["ssim"].mean
    assert floor is not None
    assert any(f"{floor:.3f}" in sentence for sentence in report.reading)
    assert any("by construction" in sentence for sentence in report.reading)


def test_limits_name_clock_repeats_and_emulation(report: ValidationReport) -> None:
    """What the report does not show is said: sync, repeats, emulated devices."""
    text = " ".join(report.limits)
    assert "nothing was triggered by hardware" in text
    assert "Repeats per force: 1" in text
    assert "Emulated here: robot" in text


def test_incomplete_run_does_not_pass(incomplete: ValidationReport) -> None:
    """A mismatch, a fault and a missing trial each fail, and the rest keeps its verdict."""
    assert not incomplete.passed
    assert [t.passed for t in incomplete.trials] == [True, False, False, False, True, True]
    assert incomplete.verdict.startswith("Not passed: 3 of 6 presses missed")
    assert incomplete.trials[3].outcome == "missing"


def test_every_miss_has_a_remedy(incomplete: ValidationReport) -> None:
    """Whatever failed says what to do."""
    missed = [c for t in incomplete.trials for c in t.criteria if not c.passed]
    assert missed
    assert all(c.remedy for c in missed)


@pytest.mark.parametrize(("force_n", "met"), [(0.079, True), (0.081, False), (-0.081, False)])
def test_force_mismatch_limit(evidence: RunEvidence, force_n: float, met: bool) -> None:
    """0.08 N counts in both directions."""
    trial = evidence.trials[0]
    assert trial.replay is not None
    assert trial.record is not None
    assert trial.record.force_measured_n is not None
    replay = replace(trial.replay, force_simulated_n=trial.record.force_measured_n + force_n)
    criteria = judge_trial(replace(trial, replay=replay), LIMITS, scores=SCORES, discriminates={})
    assert {c.name: c.passed for c in criteria}["force_mismatch"] is met


def test_ssim_limit(evidence: RunEvidence) -> None:
    """An SSIM below the threshold fails, and so does one that does not exist."""
    strict = Thresholds(max_force_mismatch_n=0.08, ssim=0.95)
    for scores in (SCORES, None):
        criteria = judge_trial(evidence.trials[0], strict, scores=scores, discriminates={})
        assert {c.name: c.passed for c in criteria}["ssim"] is False


def test_discrimination_counts_only_when_asked(evidence: RunEvidence) -> None:
    """Required discrimination leaves out the histogram, which cannot see places."""
    wins = {m.value: m is not Metric.HISTOGRAM_CORRELATION for m in Metric}
    asked = replace(LIMITS, require_discrimination=True)
    trial = evidence.trials[0]

    def names(limits: Thresholds, won: dict[str, bool]) -> dict[str, bool]:
        criteria = judge_trial(trial, limits, scores=SCORES, discriminates=won)
        return {c.name: c.passed for c in criteria}

    assert "discrimination" not in names(LIMITS, wins)
    assert names(asked, wins)["discrimination"] is True
    assert names(asked, {**wins, "ssim": False})["discrimination"] is False


def test_run_without_images_is_still_reported(
    evidence: RunEvidence, change_trial: Callable[..., RunEvidence]
) -> None:
    """A trial whose frames are gone keeps its forces and fails its SSIM."""
    changed = change_trial(
        replace(evidence, trials=evidence.trials[:2]), 1, images=None, simulated_image=None
    )
    trial = compare(changed).trials[0]
    assert trial.metrics is None
    assert trial.force_mismatch_n is not None
    assert not trial.passed


def test_empty_run_does_not_pass(evidence: RunEvidence) -> None:
    """No trial, no pass."""
    report = compare(replace(evidence, trials=()))
    assert not report.passed
    assert report.verdict.startswith("Not passed: the run has no trial.")


def test_the_verdict_says_whether_the_cell_was_checked(evidence: RunEvidence) -> None:
    """Without a known weight every force is the cell's own word, and that stands in the verdict."""
    empty = replace(evidence, trials=())
    assert compare(empty).verdict.endswith(
        "Force not checked: no known weight was hung on the cell before the run."
    )
    check = _weighed(1.003)
    assert (
        "the cell read 1.003 of the weight of 200 g (tolerance 0.061)"
        in compare(replace(empty, force_check=check)).verdict
    )
    expired = replace(check, expired="2026-01-03")
    assert "had expired" in compare(replace(empty, force_check=expired)).verdict
    wrong = compare(replace(empty, force_check=_weighed(0.1))).verdict
    assert "Force not checked: the cell read 0.1 of a weight of 200 g" in wrong


def _weighed(scale: float) -> ForceCheck:
    def tare(fz_n: float) -> Tare:
        mean, deviation = (0.0, 0.0, fz_n, 0.0, 0.0, 0.0), (0.004,) * 6
        return Tare(start_ns=0, end_ns=1, mean=mean, deviation=deviation, sample_count=200)

    weight = Weight(mass_kg=0.2, uncertainty_kg=0.002)
    return judge_weight(
        weight,
        before=tare(0.0),
        loaded=tare(-scale * weight.force_n),
        after=tare(0.0),
        compression_sign=1,
        checked="2026-01-01",
    )
