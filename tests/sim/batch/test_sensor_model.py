"""The bias of forces on a sensor's mesh: its form, and that it is known where nothing touches."""

from __future__ import annotations

import numpy as np

from sim.batch.sensor_model import Rim, bias_of, edge_of, sensor_model
from tests.sim.batch.test_batch import GEL, PAD


def test_a_contact_as_wide_as_an_edge_is_more_off_than_a_wide_one() -> None:
    """Bias and what may remain fall as contacts grow, and with the mesh's edges."""
    coarse, fine = (sensor_model(PAD, GEL, edge_m=edge) for edge in (4e-3, 2e-3))
    area = np.pi * (np.array([1.0, 3.0]) * edge_of(coarse)) ** 2
    rims = np.full(2, Rim.ROUND)
    bias, left = bias_of(coarse, rims).of(area)
    finer, finer_left = bias_of(fine, rims).of(area)
    assert bias[0] > bias[1]
    assert left[0] > left[1]
    assert (finer_left < left).all()
    assert abs(finer[1]) < abs(bias[1])


def test_without_contact_nothing_is_infinite() -> None:
    """An indenter in the air has a bias that does no harm, as has one that was not found."""
    model = sensor_model(PAD, GEL, edge_m=4e-3)
    bias, left = bias_of(model, np.full(2, Rim.SHARP)).of(np.array([0.0, np.nan]))
    assert np.isfinite(bias).all()
    assert np.isfinite(left).all()
