"""Sums over samples: what they leave over, and how those of presses add up."""

from __future__ import annotations

import numpy as np
import pytest

from sim.optics.calibrate.photometric_fit import NormalEquations, PhotometricSamples


def _press(seed: int) -> tuple[np.ndarray, PhotometricSamples]:
    rng = np.random.default_rng(seed)
    samples = PhotometricSamples(
        surface=np.zeros((1, 4, 40)),
        position=np.zeros((2, 40)),
        change=rng.normal(0.0, 10.0, (3, 40)),
        weights=rng.integers(0, 3, (3, 40)).astype(np.float64),
    )
    return rng.normal(0.0, 1.0, (6, 40)), samples


def test_misfit_is_what_a_fit_leaves_over() -> None:
    """The sums give the weighted squares of the residual without the samples."""
    features, samples = _press(1)
    sums = NormalEquations.of(features, samples)
    coefficients = sums.solved(1e-4)
    off = (samples.change - coefficients @ features) * samples.weights
    assert sums.misfit(coefficients) == pytest.approx(np.sum(off**2))
    assert sums.known_count == np.count_nonzero(samples.weights)


def test_sums_of_presses_are_those_of_all_their_samples() -> None:
    """Two presses added up are fitted as their samples are when they stand side by side."""
    (one, first), (other, second) = _press(2), _press(3)
    total = NormalEquations.total(
        [NormalEquations.of(one, first), NormalEquations.of(other, second)]
    )
    features = np.concatenate([one, other], axis=1)
    change = np.concatenate([first.change, second.change], axis=1)
    weights = np.concatenate([first.weights, second.weights], axis=1)
    for colour, coefficients in enumerate(total.solved(1e-3)):
        known = features * weights[colour]
        held = known @ known.T + 1e-3 * 80 * np.eye(6)
        load = known @ (change * weights)[colour]
        np.testing.assert_allclose(coefficients, np.linalg.solve(held, load), rtol=1e-9)
