"""Lean and arm from moments, with made-up truth."""

from __future__ import annotations

import numpy as np
import pytest

from reports.evidence.fits import fit_tilt

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
