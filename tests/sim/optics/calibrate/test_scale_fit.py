"""Scale, rotation and centre from presses at known positions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.optics.calibrate.scale_fit import fit_scale, read_positions
from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig.core.errors import ConfigError

PLACES = np.random.default_rng(3).uniform(-6e-3, 6e-3, (12, 2))


@given(
    scale_x=st.floats(3e-5, 1e-4),
    scale_y=st.floats(3e-5, 1e-4),
    rotation=st.floats(-3.0, 3.0),
    mirrored=st.booleans(),
    column=st.floats(100.0, 220.0),
)
def test_any_geometry_is_recovered(
    scale_x: float, scale_y: float, rotation: float, mirrored: bool, column: float
) -> None:
    """Exact centres give the geometry back, mirrored or not."""
    true = CameraGeometry(
        width=320,
        height=240,
        scale_x_m=scale_x,
        scale_y_m=scale_y,
        centre_x_px=column,
        centre_y_px=117.0,
        rotation_rad=rotation,
        mirrored=mirrored,
    )
    fit = fit_scale(PLACES, true.to_pixels(PLACES), width=320, height=240)
    assert fit.residual_px < 1e-6
    assert fit.geometry.mirrored is mirrored
    assert fit.geometry.to_pixels(PLACES) == pytest.approx(true.to_pixels(PLACES), abs=1e-6)


_LINE = np.linspace(-1e-3, 1e-3, 12)[:, None] * (1.0, 1.0)


@pytest.mark.parametrize(
    ("places", "pixels", "message"),
    [
        (PLACES[:3], PLACES[:3] * 1e4, "3 presses"),
        (_LINE, _LINE * 1e5, "one line in the image"),
        (_LINE, PLACES * 2e4, "all places lie on one line on the gel"),
        (np.zeros((12, 2)), PLACES * 2e4, "all places lie on one line on the gel"),
    ],
)
def test_presses_that_fix_no_scale_are_refused(
    places: np.ndarray, pixels: np.ndarray, message: str
) -> None:
    """Three points leave nothing to judge by; a line, here or there, fixes no second scale."""
    with pytest.raises(ConfigError, match=message):
        fit_scale(places, pixels, width=320, height=240)


@pytest.mark.parametrize("value", ["nan", "inf"])
def test_a_place_that_is_none_is_refused(tmp_path: Path, value: str) -> None:
    """The message names the line."""
    (tmp_path / "positions.csv").write_text(f"image,x_m,y_m\na.png,{value},0\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=rf"positions.csv, line 2: x_m is {value}"):
        read_positions(tmp_path / "positions.csv")
