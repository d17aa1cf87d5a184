"""The verdict, its sentences and its criteria."""

import re
from collections.abc import Callable
from dataclasses import replace
from hashlib import sha256
from typing import Any

import pytest

from reports.comparison.result_types import ValidationReport
from reports.comparison.run_comparison import compare
from reports.comparison.verdict_sentences import fits_of
from reports.evidence.evidence_types import RunEvidence
from tacauchy_rig.core.force_sensor_gain import ForceHistory, TrialForce
from tacauchy_rig.core.known_weight import ForceCheck, Weight, judge_weight
from tacauchy_rig.core.run import Imported, Tare
from tacauchy_rig.core.simulated import FoundValue
from tests.made_model import made_model


def test_good_run_passes(report: ValidationReport) -> None:
    """Six passing trials pass, and the sentence says on what; none of it is by construction."""
    assert report.passed
    assert report.verdict.startswith("Passed: in all 6 presses on emulated devices, the image")
    assert "of the image change in the contact is unexplained (limit 90 %)" in report.verdict
    assert "times its standard uncertainty (limit 2)" in report.verdict
    assert "0.08 N" not in report.verdict
    assert "SSIM" not in report.verdict


def test_the_abstract_can_be_quoted(report: ValidationReport, evidence: RunEvidence) -> None:
    """One sentence: presses, forces, SSIM beside its floor, force error and uncertainty."""
    ssim, floor = (
        scores["ssim"].mean for scores in (report.statistics.metrics, report.statistics.no_contact)
    )
    assert report.abstract.startswith("In 6 presses on emulated devices at forces between 1.2")
    assert f"SSIM of {ssim:.3f} against {floor:.3f} for the no-contact image" in report.abstract
    assert re.search(r"\([+−]\d+\.\d ± \d+\.\d\) % on average", report.abstract)
    assert " with errors that all presses share: at least ± 4 % to 5 %)" in report.abstract
    assert report.abstract.count(". ") == 0
    assert compare(replace(evidence, trials=())).abstract == ""


def test_images_of_no_contact_do_not_pass(evidence: RunEvidence) -> None:
    """The unloaded frame in place of every simulated image misses by name, in every trial."""
    trials = tuple(
        replace(t, simulated_image=t.images.reference) for t in evidence.trials[:2] if t.images
    )
    report = compare(replace(evidence, trials=trials))
    assert not report.passed
    for trial in report.trials:
        missed = {c.name: c for c in trial.criteria if not c.passed}
        assert missed.keys() >= {"force_margin", "contact_residual"}
        assert missed["contact_residual"].measured == 1.0
    assert "force margin" in report.verdict
    assert "contact residual 1," in report.verdict


def test_shuffled_images_do_not_pass(evidence: RunEvidence) -> None:
    """Two neighbours' images exchanged: a wrong force wins in both, and only there."""
    four = evidence.trials[1:5]
    images = [t.simulated_image for t in four]
    images[1], images[2] = images[2], images[1]
    trials = tuple(replace(t, simulated_image=image) for t, image in zip(four, images, strict=True))
    report = compare(replace(evidence, trials=trials))
    lost = [
        t.index
        for t in report.trials
        for c in t.criteria
        if c.name == "force_margin" and not c.passed
    ]
    assert lost == [3, 4]


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
    at_end = "Force not checked at the end"
    assert at_end in compare(replace(empty, force_check=check)).verdict
    assert at_end not in compare(replace(empty, force_check=check, weighed_after=True)).verdict
    expired = replace(check, expired="2026-01-03")
    assert "had expired" in compare(replace(empty, force_check=expired)).verdict
    allowed = compare(replace(empty, unchecked_allowed=True)).verdict
    assert allowed.endswith("(limits.allow_unchecked_force).")
    checked = compare(replace(empty, force_check=check, unchecked_allowed=True)).verdict
    assert "allow_unchecked_force" not in checked
    wrong = compare(replace(empty, force_check=_weighed(0.1))).verdict
    assert "Force not checked: the cell read 0.1 of a weight of 200 g" in wrong
    trial = TrialForce(index=1, gain=0.97, gain_uncertainty=0.03)
    history = ForceHistory(trials=(trial,), sources=("the arm's estimate", "the stated gel"))
    agreed = compare(replace(empty, force_history=history)).verdict
    assert "estimate and the stated gel agree with the force of every trial to within 9 %" in agreed
    faulty = replace(history, fault="the gain changed")
    assert "found faulty: the gain changed" in compare(replace(empty, force_history=faulty)).verdict


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


@pytest.mark.parametrize(
    ("told", "is_own"),
    [
        ({"source": "39 ball presses in digit"}, True),
        ({"source": "39 ball presses in other"}, False),
        ({"source": "39 ball presses in digit", "images_sha256": ["a" * 64]}, False),
        ({"source": "39 ball presses in other", "images_sha256": ["b" * 64]}, True),
        ({"images_sha256": "pixels"}, True),
    ],
)
def test_optics_from_the_judged_images_are_in_sample(
    evidence: RunEvidence, told: dict[str, Any], is_own: bool
) -> None:
    """By pixels or file; of files that name no image by the folder: that is a warning."""
    files = {"press.png": "b" * 64}
    imported = Imported(
        kind="csv", source="digit", has_clock=False, unknown=(), notes=(), trials=(), files=files
    )
    if told.get("images_sha256") == "pixels":
        images = evidence.trials[0].images
        assert images is not None
        told = {"images_sha256": [sha256(images.real.tobytes()).hexdigest()]}
    model = replace(made_model(), optics=told, modulus_factor=None)
    fits = fits_of(replace(evidence, model=model, imported=imported))
    (optics,) = [fit for fit in fits if fit.what.startswith("Optics")]
    assert optics.in_sample is is_own
    assert ("these same presses" in optics.source) is is_own


def test_a_fitted_modulus_is_in_sample_and_a_stated_one_is_not(evidence: RunEvidence) -> None:
    """The first row says which, and that predicted forces do not use the fit."""
    for factor in (None, 1.1):
        model = replace(made_model(), modulus_factor=factor, modulus_trials=6)
        fit = fits_of(replace(evidence, model=model))[0]
        assert fit.in_sample is (factor is not None)
        assert "redicted forces" in fit.effect


def test_a_place_found_for_one_of_several_indenters_is_told(evidence: RunEvidence) -> None:
    """It is so of the second, and a stated tilt is not in-sample because the place is."""
    place = FoundValue(
        name="offset along x", value=3e-5, uncertainty=1e-6, unit="m", taken=True, basis=""
    )
    moved = made_model(found_offset_m=(3e-5, 0.0), found=(place,), tilt_rad=(0.01, 0.0))
    fits = {
        fit.what: fit for fit in fits_of(replace(evidence, model=made_model(), others=(moved,)))
    }
    assert fits["Place of the indenter"].value == "at most 0.030 mm from the stated place"
    assert fits["Place of the indenter"].in_sample
    assert not fits["Tilt of the indenter"].in_sample
