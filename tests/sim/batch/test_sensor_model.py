"""The bias of forces on a sensor's mesh."""

from __future__ import annotations

import numpy as np

from sim.batch.sensor_model import Rim, bias_of, edge_of, sensor_model
from tests.sim.batch.test_batch import GEL, PAD


def test_a_contact_as_wide_as_an_edge_is_more_off_than_a_wide_one() -> None:
    """Bias and what may remain fall as contacts grow, and with the mesh's edges."""
    coarse, fine = (sensor_model(PAD, GEL, edge_m=edge) for edge in (4e-3, 2e-3))
    area = np.pi * (np.array([1.0, 3.0]) * edge_of(coarse)) ** 2
    rims = np.full(2, Rim.ROUND)
    narrow = area**-0.75
    (bias, left), (finer, finer_left) = (
        (each.constant + each.slope * narrow, each.constant_left + each.slope_left * narrow)
        for each in (bias_of(coarse, rims), bias_of(fine, rims))
    )
    assert bias[0] > bias[1]
    assert left[0] > left[1]
    assert (finer_left < left).all()
    assert abs(finer[1]) < abs(bias[1])
