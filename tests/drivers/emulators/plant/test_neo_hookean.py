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


def test_what_leaves_the_plane_is_the_derivative_of_the_whole_stress() -> None:
    """In three dimensions, by central differences, about an axisymmetric state."""
    law = NeoHookean(poisson=0.45)
    plane = np.array([1.1, 0.2, -0.1, 0.8, 1.05])

    def stress(out: np.ndarray) -> np.ndarray:
        gradient = np.zeros((3, 3))
        gradient[0, 0], gradient[0, 2], gradient[2, 0], gradient[2, 2], gradient[1, 1] = plane
        gradient[0, 1], gradient[1, 0], gradient[1, 2], gradient[2, 1] = out
        j, inverse = np.linalg.det(gradient), np.linalg.inv(gradient).T
        ic = np.sum(gradient**2)
        whole = law.shear * j ** (-2 / 3) * (gradient - ic / 3.0 * inverse)
        whole += law.bulk * (j - 1.0) * j * inverse
        return np.array([whole[0, 1], whole[1, 0], whole[1, 2], whole[2, 1]])

    step = 1e-6
    columns = [(stress(step * e) - stress(-step * e)) / (2.0 * step) for e in np.eye(4)]
    np.testing.assert_allclose(law.turning_tangent(plane), np.array(columns).T, atol=1e-8)
