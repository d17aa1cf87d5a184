"""Distance functions of the tips: unit gradients that are derivatives, and heights that agree."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.emulators.plant.tips import CylinderTip, SphereTip, Tip

TIPS: list[Tip] = [
    CylinderTip(diameter_m=5e-3, fillet_m=1e-4),
    CylinderTip(diameter_m=5e-3, fillet_m=0.0),
    SphereTip(diameter_m=4.7e-3),
]
STEP = 1e-9


@pytest.mark.parametrize("tip", TIPS)
@given(r=st.floats(1e-4, 4e-3), z=st.floats(-2e-3, -1e-5))
def test_gradient_is_the_derivative(tip: Tip, r: float, z: float) -> None:
    """Below the tip the gradient has length one and agrees with finite differences."""
    here = tip.distance(np.array([r]), np.array([z]))
    assert np.linalg.norm(here.gradient) == pytest.approx(1.0)
    along_r = tip.distance(np.array([r - STEP, r + STEP]), np.array([z, z])).value
    along_z = tip.distance(np.array([r, r]), np.array([z - STEP, z + STEP])).value
    slopes = [np.diff(along_r)[0] / (2 * STEP), np.diff(along_z)[0] / (2 * STEP)]
    np.testing.assert_allclose(here.gradient[0], slopes, atol=1e-3)


@pytest.mark.parametrize("tip", TIPS)
def test_the_underside_is_at_distance_zero(tip: Tip) -> None:
    """Height and distance describe the same body."""
    r = np.linspace(0.0, 0.499 * tip.diameter_m, 50)
    np.testing.assert_allclose(tip.distance(r, tip.height(r)).value, 0.0, atol=1e-12)
    assert np.isinf(tip.height(np.array([0.51 * tip.diameter_m])))[0]
