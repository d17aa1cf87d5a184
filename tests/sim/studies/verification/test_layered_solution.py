"""The exact layer against published factors and its limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.studies.verification.exact import (
    BondedLayers,
    Ply,
    hertz_force,
    surface_compliance,
)
from tacauchy_rig.core.errors import ConfigError


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
    assert BondedLayers([Ply(1e5, poisson, 1.0)]).punch_factor(ratio) == pytest.approx(
        kappa, abs=6e-4
    )


def test_punch_on_a_half_space_is_sneddons() -> None:
    """On a very thick layer F = 2 a E d / (1 - nu^2)."""
    force = BondedLayers([Ply(1e6, 0.3, 10.0)]).punch_force(radius_m=1e-3, depth_m=1e-5)
    assert force == pytest.approx(2e-3 * 1e6 * 1e-5 / (1.0 - 0.09), rel=3e-4)


@pytest.mark.parametrize("poisson", [0.3, 0.48])
def test_ball_on_a_thick_layer_follows_hertz_with_the_known_first_correction(
    poisson: float,
) -> None:
    """F = Hertz (1 - 2 a0 sqrt(R d) / (pi h)), Dimitriadis et al. 2002, bonded layer."""
    press = {"radius_m": 2e-3, "depth_m": 2e-5}
    force, contact = BondedLayers([Ply(1e6, poisson, 20e-3)]).ball_force(**press)
    ratio = math.sqrt(2e-3 * 2e-5) / 20e-3
    first = -(1.2876 - 1.4678 * poisson + 1.3442 * poisson**2) / (1.0 - poisson)
    expected = hertz_force(**press, young_pa=1e6, poisson=poisson)
    assert force == pytest.approx(expected * (1.0 - 2.0 * first * ratio / math.pi), rel=5e-4)
    assert contact == pytest.approx(math.sqrt(2e-3 * 2e-5), rel=0.01)


@given(poisson=st.floats(0.0, 0.5), wave=st.floats(0.01, 39.0))
def test_one_layer_has_the_known_compliance(poisson: float, wave: float) -> None:
    """Its closed form; a rigid base can only stiffen, and 1 is exceeded by a little at most."""
    compliance = float(surface_compliance([Ply(1.0, poisson, 1.0)], np.array([wave]))[0])
    k = 3.0 - 4.0 * poisson
    rising = 2.0 * k * math.sinh(2.0 * wave) - 4.0 * wave
    closed = rising / (2.0 * k * math.cosh(2.0 * wave) + 4.0 * wave**2 + 1.0 + k**2)
    assert compliance == pytest.approx(closed, rel=1e-6)
    assert 0.0 < compliance < 1.2


def test_no_layers_have_no_punch_force() -> None:
    """A laminate needs a layer."""
    with pytest.raises(ConfigError, match="no layers"):
        BondedLayers(())


def test_pressures_carry_the_force() -> None:
    """A ball's and a punch's p integrate to F; rings are closer towards the singular rim."""
    layers = BondedLayers([Ply(0.3e6, 0.49, 3e-3)])
    turns = 0.5 * math.pi * (np.arange(2000) + 0.5) / 2000
    places, rings = np.sin(turns), 2.0 * math.pi * np.sin(turns) * np.cos(turns) * np.diff(turns)[0]
    punch = {"radius_m": 2e-3, "depth_m": 2e-5}
    pressure = layers.punch_pressure(2e-3 * places, **punch)
    assert 4e-6 * pressure @ rings == pytest.approx(layers.punch_force(**punch), rel=1e-5)
    ball = {"radius_m": 16e-3, "depth_m": 5e-5}
    force, contact = layers.ball_force(**ball)
    pressure = layers.ball_pressure(contact * places, **ball)
    assert contact**2 * pressure @ rings == pytest.approx(force, rel=1e-5)
    assert layers.ball_pressure(np.array([1.1 * contact]), **ball)[0] == 0.0
