"""A cut without mechanics: the indenter's own shape where it lies below the gel, gel elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from sim.scene.indenter import Sphere
from sim.scene.pad import BoxPad
from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig.app.judging.of_run import rigid_heights

DEPTH_M, PLACE_M, DIAMETER_M = 0.5e-3, (1e-3, -0.5e-3), 8e-3


@pytest.mark.parametrize("dome_m", [np.inf, 60e-3])
def test_a_ball_cuts_a_cap(dome_m: float) -> None:
    """The deepest point is as deep as was asked, at its place, and a cap has the ball's edge."""
    pad = BoxPad(size_x_m=20e-3, size_y_m=16e-3, height_m=4e-3, dome_radius_x_m=dome_m)
    view = CameraGeometry.centred(161, 121, scale_x_m=0.1e-3, scale_y_m=0.1e-3)
    rest, loaded = rigid_heights(
        pad, Sphere(diameter_m=DIAMETER_M), view, depth_m=DEPTH_M, place_m=PLACE_M
    )
    cut = rest - loaded
    x, y = view.pad_grid()
    away = np.hypot(x - PLACE_M[0], y - PLACE_M[1])
    row, column = np.unravel_index(np.argmin(away), away.shape)
    assert cut[row, column] == pytest.approx(DEPTH_M)
    assert cut.min() == 0.0
    radius_m = 0.5 * DIAMETER_M
    edge_m = np.sqrt(radius_m**2 - (radius_m - DEPTH_M) ** 2)
    if np.isinf(dome_m):
        assert cut[row, column] == cut.max()
        assert away[cut > 0.0].max() == pytest.approx(edge_m, abs=view.scale_x_m)
