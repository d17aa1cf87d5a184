"""Floors, ceilings and the wrong-force matrix."""

import math
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from reports.comparison.result_types import ValidationReport
from reports.comparison.run_comparison import compare
from reports.evidence.evidence_types import RunEvidence, TrialEvidence, TrialImages
from reports.scores.image_metrics import (
    CeilingKind,
    Metric,
    SkillStatus,
    flat_mean_image,
    score,
    skill,
    trial_ceiling,
    trial_floors,
)
from reports.scores.wrong_forces import (
    CONTACT_RESIDUAL,
    WrongForceMatrix,
    cross_scores,
    force_margins,
    wrong_force_matrices,
)


def matrices_of(trials: Sequence[TrialEvidence]) -> tuple[WrongForceMatrix, ...]:
    """Score trials against one another."""
    return wrong_force_matrices(trials, cross_scores(trials))


def test_floors_are_the_no_contact_frame_and_the_mean_colour(evidence: RunEvidence) -> None:
    """The flat floor is one colour: the real image's mean, rounded."""
    images = evidence.trials[0].images
    assert trial_floors(images, []).no_contact == score(images.real, images.reference)
    flat = flat_mean_image(images.real)
    assert len(np.unique(flat.reshape(-1, 3), axis=0)) == 1
    assert np.allclose(flat[0, 0], images.real.reshape(-1, 3).mean(axis=0), atol=0.5)


def test_wrong_force_floor_is_the_hardest(report: ValidationReport) -> None:
    """Per score it is the best off-diagonal value of the trial's row."""
    for matrix in report.matrices[:5]:
        pick = max if matrix.larger_is_better else min
        for k, trial in enumerate(report.trials):
            row = [v for j, v in enumerate(matrix.values[k]) if j != k]
            assert trial.floors.wrong_force.value(Metric(matrix.metric)) == pick(row)


def clean(evidence: RunEvidence, made: SimpleNamespace) -> RunEvidence:
    """Return the run with images that are right but for their rounding."""
    reference = made.to_image(made.background())
    trials = []
    for trial, force in zip(evidence.trials, made.FORCES_N, strict=True):
        pressed = made.to_image(made.background() + made.contact_change(force))
        images = replace(trial.images, real=pressed, reference=reference)
        trials.append(replace(trial, images=images, simulated_image=pressed))
    return replace(evidence, trials=tuple(trials))


def test_diagonal_wins_for_a_perfect_simulator(
    evidence: RunEvidence, made: SimpleNamespace
) -> None:
    """With the right images the right force wins every row of every score."""
    matrices = matrices_of(clean(evidence, made).trials)
    assert [m.metric for m in matrices] == [*(m.value for m in Metric), CONTACT_RESIDUAL]
    for matrix in matrices:
        assert all(matrix.diagonal_wins), matrix.metric


def test_diagonal_loses_when_the_images_are_swapped(
    evidence: RunEvidence, made: SimpleNamespace
) -> None:
    """Two swapped simulated images lose exactly their two rows."""
    trials = list(clean(evidence, made).trials)
    first, last = trials[0].simulated_image, trials[5].simulated_image
    trials[0] = replace(trials[0], simulated_image=last)
    trials[5] = replace(trials[5], simulated_image=first)
    for matrix in matrices_of(trials):
        assert matrix.diagonal_wins == (False, True, True, True, True, False)


def test_ties_do_not_win(evidence: RunEvidence) -> None:
    """The same simulated image for every force wins no row."""
    third = evidence.trials[2]
    trials = [replace(third, index=k, force_target_n=float(k)) for k in (1, 2, 3)]
    for matrix in matrices_of(trials):
        assert not any(matrix.diagonal_wins)


def test_light_between_trials_does_not_pass_for_force(
    evidence: RunEvidence, made: SimpleNamespace
) -> None:
    """Where all replays show one press, lamps that warm up between trials win no row."""
    simulated = made.contact_change(3.0)
    trials = []
    for k, trial in enumerate(evidence.trials):
        light = (1.0 + 0.02 * k) * made.background()
        reference, real = made.to_image(light), made.to_image(light + made.contact_change(3.0))
        images = replace(trial.images, real=real, reference=reference)
        shown = made.to_image(reference + simulated)
        trials.append(replace(trial, images=images, simulated_image=shown))
    for matrix in matrices_of(trials):
        assert not any(matrix.diagonal_wins), matrix.metric


@pytest.mark.parametrize("apart_n", [0.0, 0.079])
def test_repeats_are_not_wrong_forces(evidence: RunEvidence, apart_n: float) -> None:
    """A repeat may score as well, also one whose force was measured: only others can beat it."""
    first = replace(evidence.trials[0], force_tolerance_n=0.08)
    repeat = replace(first, index=7, force_target_n=first.force_target_n + apart_n)
    for matrix in matrices_of([first, repeat, evidence.trials[5]]):
        if matrix.metric != "histogram_correlation":
            assert matrix.diagonal_wins[:2] == (True, True), matrix.metric


def test_one_trial_has_no_wrong_force(evidence: RunEvidence) -> None:
    """A single press cannot be compared with another force."""
    report = compare(replace(evidence, trials=evidence.trials[:1]))
    assert report.matrices == ()
    assert report.trials[0].floors.wrong_force is None


def test_ceiling_says_where_it_comes_from(evidence: RunEvidence) -> None:
    """Two halves of a dwell are called noise; another press to the same force a repeat."""
    first, second = evidence.trials[:2]
    noise = trial_ceiling(first, [second])
    assert noise.kind is CeilingKind.NOISE
    repeated = replace(second, force_target_n=first.force_target_n)
    ceiling = trial_ceiling(first, [repeated])
    assert ceiling.kind is CeilingKind.REPEAT
    assert trial_ceiling(replace(first, images=None), [second]) is None


@pytest.mark.parametrize(
    ("value", "ceiling", "noise", "larger", "expected", "status"),
    [
        (0.95, 1.0, 0.001, True, 0.5, SkillStatus.STATED),
        (0.90, 1.0, 0.001, True, 0.0, SkillStatus.STATED),
        (0.80, 1.0, 0.001, True, -1.0, SkillStatus.STATED),
        (1.05, 1.0, 0.001, True, 1.5, SkillStatus.ABOVE_CEILING),
        (0.95, 1.0, 0.05, True, None, SkillStatus.NOT_DISCRIMINATING),
        (0.95, 0.85, 0.001, True, None, SkillStatus.NOT_DISCRIMINATING),
        (0.50, 0.1, 0.001, False, 0.5, SkillStatus.STATED),
        (0.50, 2.0, 0.001, False, None, SkillStatus.NOT_DISCRIMINATING),
        (math.nan, 1.0, 0.001, True, None, SkillStatus.NOT_DISCRIMINATING),
        (0.95, math.inf, 0.001, True, None, SkillStatus.NOT_DISCRIMINATING),
        (0.95, None, 0.001, True, None, SkillStatus.NO_CEILING),
    ],
)
def test_skill(
    value: float,
    ceiling: float | None,
    noise: float,
    larger: bool,
    expected: float | None,
    status: SkillStatus,
) -> None:
    """Skill is stated only between a floor of 0.9 and a ceiling that stands out from it."""
    found = skill(value, 0.9, ceiling, noise=noise, larger_is_better=larger)
    assert found.status is status
    assert found.value == (None if expected is None else pytest.approx(expected))


NOISE_LEVELS = 2.0


def shot(made: SimpleNamespace, force_n: float, rng: np.random.Generator) -> TrialEvidence:
    """Return a trial whose halves differ by noise only, and whose simulated image is right."""
    pressed = made.background() + made.contact_change(force_n)
    reference = made.to_image(made.background())

    def half() -> np.ndarray:
        return made.to_image(pressed + rng.normal(0.0, NOISE_LEVELS, pressed.shape))

    return replace(
        TrialEvidence(index=round(force_n * 1e3), force_target_n=force_n),
        images=TrialImages(real=half(), reference=reference, first_half=half(), second_half=half()),
        simulated_image=made.to_image(made.background() + made.contact_change(1.05 * force_n)),
    )


def test_margins_are_those_of_the_matrix(evidence: RunEvidence) -> None:
    """Best wrong residual minus the own one; no contact and each press of a force are rivals."""
    again = replace(evidence.trials[5], index=7, force_target_n=evidence.trials[1].force_target_n)
    trials = [*evidence.trials, again]
    residuals = wrong_force_matrices(trials, cross_scores(trials))[-1]
    assert residuals.metric == CONTACT_RESIDUAL
    margins = force_margins(trials)
    for trial, row in zip(trials, residuals.values, strict=True):
        wrong = [v for t, v in zip(trials, row, strict=True) if t.is_wrong_for(trial)]
        own = row[trials.index(trial)]
        assert margins[trial.index].value == pytest.approx(min(1.0, *wrong) - own)


def test_spread_is_what_noise_does_to_the_margin(made: SimpleNamespace) -> None:
    """Over many draws the margin of half a dwell scatters by the spread over the root of two."""
    forces = made.FORCES_N[:3]
    values: dict[int, list[float]] = {}
    spreads: dict[int, list[float]] = {}
    for seed in range(12):
        rng = np.random.default_rng(seed)
        for index, margin in force_margins([shot(made, f, rng) for f in forces]).items():
            values.setdefault(index, []).append(margin.value)
            assert margin.spread is not None
            spreads.setdefault(index, []).append(margin.spread)
    scatter = [np.std(v, ddof=1) for v in values.values()]
    stated = [np.sqrt(np.mean(np.square(v))) for v in spreads.values()]
    ratio = np.array(scatter) * np.sqrt(2.0) / stated
    assert np.all(ratio > 0.5)
    assert np.all(ratio < 2.0)


def test_repeats_scatter_more_than_noise(evidence: RunEvidence) -> None:
    """Two presses to one force that differ count as what a repeat leaves."""
    first, second = evidence.trials[0], evidence.trials[3]
    again = replace(second, force_target_n=first.force_target_n)
    margins = force_margins([first, again, *evidence.trials[4:]])
    apart = np.std([margins[1].value, margins[again.index].value], ddof=1)
    assert margins[1].spread == pytest.approx(apart)


def test_no_contact_is_never_in_front(evidence: RunEvidence) -> None:
    """With the unloaded frame for every image nothing is told from nothing."""
    trials = [replace(t, simulated_image=t.images.reference) for t in evidence.trials if t.images]
    for margin in force_margins(trials).values():
        assert margin.value == 0.0
        assert margin.in_spreads == 0.0


def test_a_dwell_whose_images_changed_blinds_no_other(made: SimpleNamespace) -> None:
    """One trial whose camera showed an older press first: its own margin is lost, no other."""
    rng = np.random.default_rng(0)
    trials = [shot(made, force, rng) for force in made.FORCES_N[:5]]
    third = trials[2]
    assert third.images is not None
    assert trials[1].images is not None
    trials[2] = replace(third, images=replace(third.images, first_half=trials[1].images.real))
    after = force_margins(trials)
    assert after[third.index].in_spreads < 3.0
    for trial in (*trials[:2], *trials[3:]):
        assert after[trial.index].in_spreads > 10.0
