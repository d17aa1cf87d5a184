"""Exact shear under a body that is carried or turned: its resultants and its limits."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sim.studies.verification import exact
from tacauchy_rig.core.arrays import FloatArray

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
