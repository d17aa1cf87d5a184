"""The stable neo-Hookean law: at rest without stress, there Hooke's, and finite inside out."""

from __future__ import annotations

import numpy as np
import pytest

from sim.material.laws import linear
from sim.material.laws.stable_neo_hookean import LAW
from tests.sim.material.laws.at_a_point import (
    YOUNG_PA,
    deformed,
    derivative_errors,
    energy,
    evaluated,
    stress,
    turn,
)


def test_stress_and_tangent_are_derivatives() -> None:
    """Of the energy and of the stress, by central differences."""
    assert max(derivative_errors(LAW)) < 5e-9


def test_rest_is_free_of_stress_and_as_stiff_as_hookes_law() -> None:
    """Which the law as the paper prints it is not."""
    rng = np.random.default_rng(2)
    g, h = rng.normal(size=(2, 3))
    rest = np.eye(3)[None]
    assert energy(LAW, np.eye(3)) == 0.0
    assert np.abs(stress(LAW, np.eye(3))).max() < 1e-12 * YOUNG_PA
    found, hooke = (evaluated(law, rest, g, h)[2][0] for law in (LAW, linear.LAW))
    assert np.abs(found - hooke).max() < 1e-12 * np.abs(hooke).max()


def test_a_turn_turns_the_stress_and_costs_nothing() -> None:
    """Objective: psi(Q F) = psi(F), P(Q F) = Q P(F)."""
    for F in deformed():
        assert energy(LAW, turn() @ F) == pytest.approx(energy(LAW, F), rel=1e-9)
        apart = stress(LAW, turn() @ F) - turn() @ stress(LAW, F)
        assert np.abs(apart).max() < 1e-10 * np.abs(stress(LAW, F)).max()


def test_a_gel_turned_inside_out_is_pushed_back() -> None:
    """Energy and stress stay finite at J <= 0, and the stress points back to rest."""
    flat, out = np.diag([1.0, 1.0, 0.0]), np.diag([1.0, 1.0, -0.2])
    assert 0.0 < energy(LAW, flat) < energy(LAW, out) < np.inf
    assert stress(LAW, out)[2, 2] < stress(LAW, flat)[2, 2] < 0.0
