"""The margin of the own force over wrong ones, and how far it scatters."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from reports.evidence.evidence import RunEvidence, TrialEvidence
from reports.scores.floors import CONTACT_RESIDUAL, cross_scores, wrong_force_matrices
from reports.scores.force_margin import force_margins

NOISE_LEVELS = 2.0


def shot(made: SimpleNamespace, force_n: float, rng: np.random.Generator) -> TrialEvidence:
    """Return a trial whose halves differ by noise only, and whose simulated image is right."""
    pressed = made.background() + made.contact_change(force_n)
    reference = made.to_image(made.background())

    def half() -> np.ndarray:
        return made.to_image(pressed + rng.normal(0.0, NOISE_LEVELS, pressed.shape))

    return replace(
        TrialEvidence(index=round(force_n * 1e3), force_target_n=force_n),
        images=SimpleNamespace(  # type: ignore[arg-type]
            real=half(), reference=reference, first_half=half(), second_half=half()
        ),
        simulated_image=made.to_image(made.background() + made.contact_change(1.05 * force_n)),
    )


def test_margins_are_those_of_the_matrix(evidence: RunEvidence) -> None:
    """Best wrong residual minus the own one, with no contact as one of the rivals."""
    residuals = wrong_force_matrices(evidence.trials, cross_scores(evidence.trials))[-1]
    assert residuals.metric == CONTACT_RESIDUAL
    margins = force_margins(evidence.trials)
    for k, trial in enumerate(evidence.trials):
        row = list(residuals.values[k])
        own = row.pop(k)
        assert margins[trial.index].value == pytest.approx(min(1.0, *row) - own)


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
    stale = SimpleNamespace(**vars(third.images))
    stale.first_half = trials[1].images.real  # type: ignore[union-attr]
    trials[2] = replace(third, images=stale)  # type: ignore[arg-type]
    after = force_margins(trials)
    assert after[third.index].in_spreads < 3.0
    for trial in (*trials[:2], *trials[3:]):
        assert after[trial.index].in_spreads > 10.0
