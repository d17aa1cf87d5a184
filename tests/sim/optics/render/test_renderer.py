"""Tactile images from height maps."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.optics.colour.nominal import nominal_photometric
from sim.optics.colour.photometric import PhotometricModel, load_photometric, polynomial_exponents
from sim.optics.render.renderer import TactileRenderer
from sim.sensor.optics import Lamp
from tacauchy_rig.core.errors import ConfigError
from tests.sim.optics.analytic_surface import APEX_M, ball_press, camera

RED_FROM_THE_RIGHT = Lamp(azimuth_rad=0.0, elevation_rad=0.3, colour=(80.0, 0.0, 0.0))


def _background() -> np.ndarray:
    return np.random.default_rng(1).integers(60, 190, (96, 128, 3)).astype(np.uint8)


def _dent() -> np.ndarray:
    return ball_press(
        *camera().pad_grid(), ball_radius_m=2.35e-3, contact_radius_m=1.5e-3, tip_z_m=APEX_M - 8e-4
    )


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 1000), degree=st.integers(1, 4), place=st.integers(0, 2))
def test_unloaded_gel_gives_the_no_contact_frame(seed: int, degree: int, place: int) -> None:
    """For every model and every rest shape the unloaded image is the background, bit for bit."""
    rng = np.random.default_rng(seed)
    exponents = polynomial_exponents(
        tilt_degree=degree,
        position_degree=place,
        indentation_degree=1,
        indentation_tilt_degree=degree - 1,
    )
    model = PhotometricModel(
        exponents=exponents, coefficients=rng.normal(0, 40, (len(exponents), 3))
    )
    x, y = camera().pad_grid()
    dome = APEX_M - (x**2 + y**2) / (2 * rng.uniform(0.02, 0.2))
    image = TactileRenderer(_background(), dome, model, camera()).render(dome)
    np.testing.assert_array_equal(image, _background())


def test_nominal_model_is_lambert() -> None:
    """Colour change equals colour x (cosine of incidence - cosine at rest) up to 45 degrees."""
    model = nominal_photometric([replace(RED_FROM_THE_RIGHT, colour=(40.0, 0.0, 0.0))])
    for angle in (-0.7, -0.2, 0.3, 0.7):
        tilt = np.array([[math.sin(angle)], [0.0]], dtype=np.float32)
        change = model.evaluate(tilt, np.zeros((2, 1), np.float32), np.zeros(1, np.float32))
        expected = 40.0 * (math.sin(0.3 + angle) - math.sin(0.3))
        assert change[0, 0] == pytest.approx(expected, abs=0.2)


def test_three_lamps_light_their_own_flanks() -> None:
    """Each colour is brightest where the dent faces its lamp, 120 degrees apart."""
    model = nominal_photometric(
        [
            Lamp(
                azimuth_rad=math.radians(azimuth),
                elevation_rad=math.radians(10.0),
                colour=(70.0 * (channel == 0), 70.0 * (channel == 1), 70.0 * (channel == 2)),
            )
            for channel, azimuth in enumerate((-60.0, 60.0, 180.0))
        ]
    )
    flat = np.full((96, 128), APEX_M)
    background = np.full((96, 128, 3), 100, np.uint8)
    image = TactileRenderer(background, flat, model, camera()).render(_dent()).astype(float)
    rows, columns = np.mgrid[:96, :128]
    for channel, azimuth in enumerate((-60.0, 60.0, 180.0)):
        excess = np.maximum(image[..., channel] - 100.0, 0.0)
        x, y = np.sum(excess * (columns - 63.5)), np.sum(excess * (rows - 47.5))
        assert math.cos(math.atan2(y, x) - math.radians(azimuth)) > 0.99


def test_steeper_than_fitted_is_rendered_as_the_limit() -> None:
    """Beyond the tilt limit the colour keeps its direction and stops growing."""
    exponents = polynomial_exponents(tilt_degree=1, position_degree=0)
    model = PhotometricModel(
        exponents=exponents, coefficients=np.array([[10.0, 0, 0], [0, 20.0, 0]]), tilt_limit=0.5
    )
    tilt = np.array([[0.6, 0.3], [0.8, 0.0]], dtype=np.float32)
    change = model.evaluate(tilt, np.zeros((2, 2), np.float32), np.zeros(2, np.float32))
    np.testing.assert_allclose(change.T, [[3.0, 8.0, 0.0], [3.0, 0.0, 0.0]], atol=1e-4)


def test_background_of_another_size_is_refused() -> None:
    """A raw camera frame in place of the cropped one names both shapes."""
    model = nominal_photometric([RED_FROM_THE_RIGHT])
    flat = np.full((96, 128), APEX_M)
    with pytest.raises(ConfigError, match=r"no-contact frame has the shape \(480, 640, 3\)"):
        TactileRenderer(np.zeros((480, 640, 3), np.uint8), flat, model, camera())


@pytest.mark.parametrize("content", [None, b"", b"not a calibration"])
def test_missing_or_foreign_file_is_refused(tmp_path: Path, content: bytes | None) -> None:
    """The message names the file and the command that writes one."""
    path = tmp_path / "calibration.npz"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"calibration.npz[\s\S]*calibrate optics"):
        load_photometric(path)


def test_archive_of_something_else_is_refused(tmp_path: Path) -> None:
    """An npz without the model's keys is refused, not half read."""
    np.savez(tmp_path / "other.npz", height=np.zeros(3))
    with pytest.raises(ConfigError, match="not an optics calibration"):
        load_photometric(tmp_path / "other.npz")
