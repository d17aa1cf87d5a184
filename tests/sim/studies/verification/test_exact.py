"""The exact solutions against published ones and against each other."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.studies.verification import exact
from sim.studies.verification.exact import BondedLayers, Ply, hertz_force, surface_compliance
from tacauchy_rig.core.arrays import FloatArray
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


# Rings of a contact of radius 1, closer towards its edge, and their areas; p0 and F are 1 too.
_TURNS = 0.5 * math.pi * (np.arange(20_000) + 0.5) / 20_000
RADII = np.sin(_TURNS)
RINGS = 2.0 * math.pi * RADII * np.cos(_TURNS) * 0.5 * math.pi / len(_TURNS)
MU = 0.4


def turned_ball(strain_pa: float) -> FloatArray:
    """Return the shear under a ball of p0 = 1."""
    return exact.turned_ball_shear(
        RADII, friction=MU, pressure_pa=1.0, contact_m=1.0, shear_strain_pa=strain_pa
    )


def turned_punch(strain_pa: float) -> FloatArray:
    """Return the shear under a punch of F = 1."""
    return exact.turned_punch_shear(
        RADII, friction=MU, force_n=1.0, radius_m=1.0, shear_strain_pa=strain_pa
    )


@pytest.mark.parametrize("held", [0.2, 0.875, 1.0])
def test_a_carried_ball_passes_on_its_tangential_force(held: float) -> None:
    """Q is the integral of the shear; F = 2/3 pi p0 a^2."""
    shear = exact.carried_ball_shear(RADII, friction=MU, pressure_pa=1.0, contact_m=1.0, held=held)
    assert shear @ RINGS == pytest.approx(held * MU * 2.0 / 3.0 * math.pi, rel=1e-4)


def test_turned_a_little_a_ball_sticks_as_reissner_and_sagoci_have_it() -> None:
    """The torque is 16 / 3 G beta a^3, the shear 4 G beta / pi r / sqrt(a^2 - r^2)."""
    shear = turned_ball(1e-4)
    assert shear @ (RINGS * RADII) == pytest.approx(16.0 / 3.0 * 0.5e-4, rel=2e-3)
    at = np.searchsorted(RADII, 0.6)
    assert shear[at] == pytest.approx(2e-4 / math.pi * 0.75, rel=1e-3)


@pytest.mark.parametrize(
    ("shear", "torque"),
    [(turned_ball(4.0), math.pi**2 / 8.0), (turned_punch(0.5), math.pi / 4.0)],
    ids=["ball", "punch"],
)
def test_turned_far_the_shear_is_mu_times_the_pressure(shear: FloatArray, torque: float) -> None:
    """The torque of mu p: pi^2 / 8 mu p0 a^3 under a ball, pi / 4 mu F a under a punch."""
    assert shear @ (RINGS * RADII) == pytest.approx(MU * torque, rel=3e-3)


def test_a_punch_that_has_not_slipped_yet_has_the_stuck_torque() -> None:
    """Slip begins everywhere at the rim at once, at 2 G beta = mu F / (4 a^2)."""
    strain = 1.0001 * MU / 4.0
    assert turned_punch(strain) @ (RINGS * RADII) == pytest.approx(8.0 / 3.0 * strain, rel=2e-3)
