"""The bias of forces on a sensor's mesh: its form, and that it is known where nothing touches."""

from __future__ import annotations

import numpy as np

from sim.batch.sensor_bias import Rim, force_bias


def test_a_contact_as_wide_as_an_edge_is_more_off_than_a_wide_one() -> None:
    """Bias and what may remain fall as contacts grow, and with the mesh's edges."""
    area = np.pi * np.array([1e-3, 3e-3]) ** 2
    rims = np.full(2, Rim.ROUND)
    bias, left = force_bias(area, edge_m=1e-3, height_m=4e-3, rims=rims)
    finer, finer_left = force_bias(area, edge_m=0.5e-3, height_m=4e-3, rims=rims)
    assert bias[0] > bias[1]
    assert left[0] > left[1]
    assert (finer_left < left).all()
    assert abs(finer[1]) < abs(bias[1])


def test_without_contact_nothing_is_infinite() -> None:
    """An indenter in the air has a bias that does no harm, as has one that was not found."""
    bias, left = force_bias(
        np.array([0.0, np.nan]), edge_m=1e-3, height_m=4e-3, rims=np.full(2, Rim.SHARP)
    )
    assert np.isfinite(bias).all()
    assert np.isfinite(left).all()
