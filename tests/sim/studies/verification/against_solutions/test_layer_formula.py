"""The exact layer against published factors and its limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.studies.verification.against_solutions.layer_formula import (
    ball_force,
    hertz_force,
    layer_compliance,
    punch_factor,
    punch_force,
)


@pytest.mark.parametrize(
    ("poisson", "ratio", "kappa"),
    [
        (0.3, 0.2, 1.207),
        (0.3, 1.0, 2.484),
        (0.45, 2.5 / 4.5, 1.930),
        (0.47, 2.5 / 4.5, 1.983),
        (0.49, 2.5 / 4.5, 2.048),
        (0.499, 2.5 / 4.5, 2.081),
        (0.5, 0.4, 1.684),
        (0.5, 1.0, 3.619),
    ],
)
def test_punch_factor_is_the_published_one(poisson: float, ratio: float, kappa: float) -> None:
    """Hayes et al. 1972, and a finite-layer solution after them, to four digits."""
    assert punch_factor(ratio, poisson) == pytest.approx(kappa, abs=6e-4)


def test_punch_on_a_half_space_is_sneddons() -> None:
    """On a very thick layer F = 2 a E d / (1 - nu^2)."""
    force = punch_force(radius_m=1e-3, height_m=10.0, depth_m=1e-5, young_pa=1e6, poisson=0.3)
    assert force == pytest.approx(2e-3 * 1e6 * 1e-5 / (1.0 - 0.09), rel=3e-4)


@pytest.mark.parametrize("poisson", [0.3, 0.48])
def test_ball_on_a_thick_layer_follows_hertz_with_the_known_first_correction(
    poisson: float,
) -> None:
    """F = Hertz (1 - 2 a0 sqrt(R d) / (pi h)), Dimitriadis et al. 2002, bonded layer."""
    press = {"radius_m": 2e-3, "depth_m": 2e-5}
    force, contact = ball_force(**press, height_m=20e-3, young_pa=1e6, poisson=poisson)
    ratio = math.sqrt(2e-3 * 2e-5) / 20e-3
    first = -(1.2876 - 1.4678 * poisson + 1.3442 * poisson**2) / (1.0 - poisson)
    expected = hertz_force(**press, young_pa=1e6, poisson=poisson)
    assert force == pytest.approx(expected * (1.0 - 2.0 * first * ratio / math.pi), rel=5e-4)
    assert contact == pytest.approx(math.sqrt(2e-3 * 2e-5), rel=0.01)


@given(poisson=st.floats(0.0, 0.499), wave=st.floats(0.01, 39.0))
def test_layer_is_never_softer_than_a_half_space(poisson: float, wave: float) -> None:
    """A rigid base can only stiffen: 0 < N, and N exceeds 1 by no more than rounding's reach."""
    compliance = float(layer_compliance(np.array([wave]), poisson)[0])
    assert 0.0 < compliance < 1.2
