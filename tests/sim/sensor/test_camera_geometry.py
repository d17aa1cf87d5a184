"""Pixels and pad positions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig.core.errors import ConfigError

MINI = CameraGeometry.centred(320, 240, scale_x_m=6.34e-5, scale_y_m=6.5e-5)


@given(
    rotation=st.floats(-3.1, 3.1),
    mirrored=st.booleans(),
    column=st.floats(-50, 400),
    row=st.floats(-50, 400),
)
def test_pixel_to_pad_and_back(rotation: float, mirrored: bool, column: float, row: float) -> None:
    """The two maps are each other's inverse for every rotation and mirroring."""
    geometry = replace(MINI, rotation_rad=rotation, mirrored=mirrored)
    pixel = np.array([column, row])
    np.testing.assert_allclose(geometry.to_pixels(geometry.to_pad(pixel)), pixel, atol=1e-9)


def test_scales_of_columns_and_rows_differ() -> None:
    """One column is scale_x and one row scale_y from the centre."""
    pad = MINI.to_pad(np.array([[160.5, 119.5], [159.5, 120.5]]))
    np.testing.assert_allclose(pad, [[6.34e-5, 0.0], [0.0, 6.5e-5]], atol=1e-15)


def test_mirrored_rows_grow_with_minus_y() -> None:
    """A mirrored camera sees +y above the centre."""
    y = replace(MINI, mirrored=True).pad_grid()[1]
    assert y[0, 0] == pytest.approx(119.5 * 6.5e-5)


@pytest.mark.parametrize(
    ("field", "value"), [("width", 0), ("scale_x_m", 6.34), ("crop_fraction", 0.5)]
)
def test_impossible_geometry_is_refused(field: str, value: float) -> None:
    """Millimetres given as metres, empty images and full crops are refused by name."""
    with pytest.raises(ConfigError, match=field.removesuffix("_m")):
        replace(MINI, **{field: value})  # type: ignore[arg-type]


def test_where_the_pads_centre_is_seen() -> None:
    """From the image's middle, to the right and down; in the middle it is nought."""
    assert MINI.centre_from_middle_m == pytest.approx((0.0, 0.0), abs=1e-5)
    moved = replace(MINI, centre_x_px=MINI.centre_x_px + 10.0, centre_y_px=MINI.centre_y_px - 4.0)
    x, y = moved.centre_from_middle_m
    assert x - MINI.centre_from_middle_m[0] == pytest.approx(10.0 * MINI.scale_x_m)
    assert y - MINI.centre_from_middle_m[1] == pytest.approx(-4.0 * MINI.scale_y_m)
