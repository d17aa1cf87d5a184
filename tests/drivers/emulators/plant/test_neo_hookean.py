"""The law's stress and tangent against finite differences, and its small-strain limit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from drivers.emulators.plant.neo_hookean import NeoHookean

REST = np.array([1.0, 0.0, 0.0, 1.0, 1.0])
STEP = 1e-6


@given(arrays(np.float64, 5, elements=st.floats(-0.15, 0.15)), st.floats(0.3, 0.495))
def test_stress_and_tangent_are_derivatives(change: np.ndarray, poisson: float) -> None:
    """Stress is the energy's gradient and the tangent the stress's, at any deformation."""
    law = NeoHookean(poisson=poisson)
    for i in range(5):
        shift = np.zeros(5)
        shift[i] = STEP
        low, high = REST + change - shift, REST + change + shift
        slope = (law.energy(high) - law.energy(low)) / (2 * STEP)
        assert law.stress(REST + change)[i] == pytest.approx(slope, abs=1e-5)
        column = (law.stress(high) - law.stress(low)) / (2 * STEP)
        np.testing.assert_allclose(law.tangent(REST + change)[:, i], column, atol=1e-4)


def test_rest_is_stress_free() -> None:
    """An undeformed gel carries no stress: the paper's printed law does not manage that."""
    np.testing.assert_allclose(NeoHookean(poisson=0.48).stress(REST), 0.0, atol=1e-15)


def test_small_strain_is_hooke() -> None:
    """Uniaxial tension gives Young's modulus one."""
    law = NeoHookean(poisson=0.48)
    strain = 1e-6
    pulled = REST + strain * np.array([-0.48, 0.0, 0.0, 1.0, -0.48])
    assert law.stress(pulled)[3] / strain == pytest.approx(1.0, rel=1e-4)
    assert law.stress(pulled)[0] / strain == pytest.approx(0.0, abs=1e-3)


def test_inside_out_costs_infinite_energy() -> None:
    """An inverted element is refused by its energy, so that a line search backs off."""
    assert NeoHookean(poisson=0.48).energy(np.array([-1.0, 0.0, 0.0, 1.0, 1.0])) == np.inf
