"""Slopes of an unloaded dome, and where a ball touches it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim.optics.calibrate.gel_profile import pad_slopes, rest_slopes, touching_places
from sim.scene.pad import BoxPad
from tests.sim.optics.analytic_surface import camera

PAD = BoxPad(
    size_x_m=25e-3, size_y_m=20e-3, height_m=4e-3, dome_radius_x_m=0.185, dome_radius_y_m=0.105
)


def test_slopes_of_a_dome() -> None:
    """The top falls off by x over the radius along x, y over the other along y."""
    places = np.array([[3e-3, 0.0], [0.0, -5e-3], [2e-3, 4e-3]])
    np.testing.assert_allclose(pad_slopes(PAD, places), -places / (0.185, 0.105), rtol=1e-6)


def test_slopes_follow_the_image() -> None:
    """A camera turned by a quarter sees the slope along y along its columns."""
    turned = replace(camera(), rotation_rad=np.pi / 2)
    x, y = turned.pad_grid()
    columns, rows = rest_slopes(PAD, turned)
    np.testing.assert_allclose(columns, -y / 0.105, atol=1e-9)
    np.testing.assert_allclose(rows, x / 0.185, atol=1e-9)


def test_a_ball_touches_where_slopes_agree() -> None:
    """There the ball's lower side is as steep as the gel; on flat gel it is under the axis."""
    axes = np.array([[6e-3, -4e-3], [0.0, 0.0]])
    touched = touching_places(axes, PAD, ball_radius_m=2.35e-3)
    np.testing.assert_allclose((touched - axes) / 2.35e-3, pad_slopes(PAD, touched), atol=1e-8)
    assert np.all(np.abs(touched[0]) < np.abs(axes[0]))
    flat = replace(PAD, dome_radius_x_m=np.inf, dome_radius_y_m=np.inf)
    np.testing.assert_array_equal(touching_places(axes, flat, ball_radius_m=2.35e-3), axes)
