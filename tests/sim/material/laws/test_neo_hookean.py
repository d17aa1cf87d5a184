"""The isochoric neo-Hookean law: shape and volume cost energy apart from each other."""

from __future__ import annotations

import numpy as np
import pytest

from sim.material.laws.neo_hookean import LAW
from tests.sim.material.laws.at_a_point import (
    LAMBDA_PA,
    MU_PA,
    deformed,
    derivative_errors,
    energy,
    stress,
    turn,
)

BULK_PA = LAMBDA_PA + 2.0 / 3.0 * MU_PA


def test_stress_and_tangent_are_derivatives() -> None:
    """Of the energy and of the stress, by central differences."""
    assert max(derivative_errors(LAW)) < 5e-9


@pytest.mark.parametrize("stretch", [0.8, 1.0, 1.3])
def test_a_change_of_size_costs_volume_alone(stretch: float) -> None:
    """Energy K/2 (J - 1)^2, pressure K (J - 1), no shear."""
    ratio = stretch**3
    pressed = BULK_PA * (ratio - 1.0) * stretch**2 * np.eye(3)
    F = stretch * np.eye(3)
    np.testing.assert_allclose(stress(LAW, F), pressed, rtol=1e-10, atol=1e-9 * BULK_PA)
    assert energy(LAW, F) == pytest.approx(0.5 * BULK_PA * (ratio - 1.0) ** 2, rel=1e-9, abs=1e-9)


def test_a_change_of_shape_costs_mu_alone() -> None:
    """At J = 1 the Cauchy stress is mu dev(F F^T)."""
    F = np.diag([1.3, 1.0 / 1.3, 1.0])
    F[0, 1] = 0.2
    F[1] *= 1.0 / np.linalg.det(F)
    b = F @ F.T
    wanted = MU_PA * (b - np.trace(b) / 3.0 * np.eye(3))
    np.testing.assert_allclose(stress(LAW, F) @ F.T, wanted, rtol=1e-9, atol=1e-9 * MU_PA)


def test_a_turn_turns_the_stress_and_costs_nothing() -> None:
    """Objective: psi(Q F) = psi(F), P(Q F) = Q P(F)."""
    for F in deformed():
        assert energy(LAW, turn() @ F) == pytest.approx(energy(LAW, F), rel=1e-9)
        apart = stress(LAW, turn() @ F) - turn() @ stress(LAW, F)
        assert np.abs(apart).max() < 1e-10 * np.abs(stress(LAW, F)).max()


def test_no_energy_buys_a_gel_turned_inside_out() -> None:
    """At J = 0 and beyond."""
    assert energy(LAW, np.diag([1.0, 1.0, 0.0])) == np.inf
    assert energy(LAW, np.diag([1.0, 1.0, -0.5])) == np.inf
