"""The search for lamps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import approx_fprime

from sim.optics.calibrate.photometric_fit import PhotometricSamples, SurfacePoints, _Search


@pytest.mark.parametrize("blurred", [False, True])
def test_slopes_lead_downhill(blurred: bool) -> None:
    """The gradient of what is left over is that of differences, though the fits follow."""
    rng = np.random.default_rng(4)

    def surface() -> SurfacePoints:
        return SurfacePoints(
            tilt=rng.uniform(-0.5, 0.5, (2, 300)),
            indentation_m=rng.uniform(0.0, 1e-3, 300),
            curvature=rng.uniform(-1e3, 1e3, 300),
        )

    samples = PhotometricSamples(
        gel=surface(),
        position=rng.uniform(-1.0, 1.0, (2, 300)),
        change=rng.normal(0.0, 20.0, (3, 300)),
        weights=rng.uniform(0.0, 1.0, (3, 300)),
        rest=SurfacePoints(
            tilt=rng.uniform(-0.1, 0.1, (2, 300)),
            indentation_m=np.zeros(300),
            curvature=np.zeros(300),
        ),
        around=tuple(surface() for _ in range(4 * blurred)),
    )
    search = _Search(samples, aspect=0.75, crease_limit=1e4)
    numbers = np.array([0.3, 0.3, 2.0, 2.0, 0.5, 1.5, -1.0, 0.2, 3.0, 0.1])
    slopes = search.slopes(numbers).T @ search.left_over(numbers)
    expected = approx_fprime(numbers, lambda at: 0.5 * np.sum(search.left_over(at) ** 2), 1e-6)
    np.testing.assert_allclose(slopes, expected, rtol=1e-3, atol=1e-3 * np.abs(expected).max())
