"""The search for lamps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import approx_fprime

from sim.optics.calibrate.photometric_fit import PhotometricSamples, _Search


@pytest.mark.parametrize("blurred", [False, True])
def test_slopes_lead_downhill(blurred: bool) -> None:
    """The gradient of what is left over is that of differences, though the fits follow."""
    rng = np.random.default_rng(4)
    around = 4 * blurred
    surface = rng.uniform(-1.0, 1.0, (2 + around, 4, 300))
    surface *= np.array([0.5, 0.5, 1e-3, 1e3])[:, None]
    samples = PhotometricSamples(
        surface=surface,
        shares=(0.0 if blurred else 1.0, *[0.25] * around, -1.0),
        position=rng.uniform(-1.0, 1.0, (2, 300)),
        change=rng.normal(0.0, 20.0, (3, 300)),
        weights=rng.uniform(0.0, 1.0, (3, 300)),
    )
    search = _Search(samples, aspect=0.75, crease_limit=1e4)
    numbers = np.array([0.3, 0.3, 2.0, 2.0, 0.5, 1.5, -1.0, 0.2, 3.0, 0.1])
    slopes = search.slopes(numbers).T @ search.left_over(numbers)
    expected = approx_fprime(numbers, lambda at: 0.5 * np.sum(search.left_over(at) ** 2), 1e-6)
    np.testing.assert_allclose(slopes, expected, rtol=1e-3, atol=1e-3 * np.abs(expected).max())
