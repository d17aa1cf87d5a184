"""Hooke's law: derivatives of its energy, and the two tests that define E and nu."""

from __future__ import annotations

import numpy as np
import pytest

from sim.material.laws.linear import LAW
from tests.sim.material.laws.at_a_point import (
    MU_PA,
    POISSON,
    YOUNG_PA,
    derivative_errors,
    energy,
    stress,
)

STRAIN = 1e-2


def test_stress_and_tangent_are_derivatives() -> None:
    """Of the energy and of the stress, by central differences."""
    assert max(derivative_errors(LAW)) < 5e-9


def test_a_bar_pulled_by_its_ends_is_as_stiff_as_e_and_thins_by_nu() -> None:
    """Stress E e along, none across, and the energy is half their product."""
    F = np.diag([1.0 + STRAIN, 1.0 - POISSON * STRAIN, 1.0 - POISSON * STRAIN])
    pulled = np.diag([YOUNG_PA * STRAIN, 0.0, 0.0])
    np.testing.assert_allclose(stress(LAW, F), pulled, atol=1e-9 * YOUNG_PA * STRAIN)
    assert energy(LAW, F) == pytest.approx(0.5 * YOUNG_PA * STRAIN**2, rel=1e-12)


def test_shear_is_carried_by_mu_alone() -> None:
    """One angle, one shear stress on both pairs of faces."""
    F = np.eye(3)
    F[0, 2] = STRAIN
    sheared = np.zeros((3, 3))
    sheared[0, 2] = sheared[2, 0] = MU_PA * STRAIN
    np.testing.assert_allclose(stress(LAW, F), sheared, atol=1e-9 * MU_PA * STRAIN)


def test_a_small_turn_is_no_strain_and_a_large_one_is() -> None:
    """Why the law is said not to be objective."""
    spin = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(stress(LAW, np.eye(3) + 1e-2 * spin), 0.0, atol=1e-9 * YOUNG_PA)
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert np.abs(stress(LAW, turned)).max() > YOUNG_PA
    assert not LAW.is_objective
