"""Blur of image planes."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from sim.optics.render.gaussian import blurred, gaussian_weights


@pytest.mark.parametrize("sigma_px", [0.3, 0.75, 1.4])
def test_blur_is_the_one_that_calibrations_are_fitted_with(sigma_px: float) -> None:
    """It agrees with OpenCV's, borders included."""
    planes = np.random.default_rng(0).normal(0.0, 60.0, (3, 24, 31)).astype(np.float32)
    expected = np.stack([cv2.GaussianBlur(plane, (0, 0), sigma_px) for plane in planes])
    np.testing.assert_allclose(blurred(planes, gaussian_weights(sigma_px)), expected, atol=2e-4)


def test_no_blur_leaves_the_planes() -> None:
    """A standard deviation of 0 changes nothing."""
    planes = np.random.default_rng(0).normal(size=(2, 5, 6)).astype(np.float32)
    np.testing.assert_array_equal(blurred(planes, gaussian_weights(0.0)), planes)
