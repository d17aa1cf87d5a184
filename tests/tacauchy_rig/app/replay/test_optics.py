"""Which calibration a run's images are rendered with."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim.optics.colour.photometric import PhotometricModel
from sim.sensor.sensor import Sensor, load_sensor
from tacauchy_rig.app.replay.optics import OpticalCalibration, Say, calibrated_optics, optics_of
from tacauchy_rig.core.errors import ConfigError

MINI = load_sensor("gelsight-mini")
VIEW = MINI.camera


def _calibration(tmp_path: Path, **provenance: object) -> str:
    made = {
        "width_px": VIEW.width,
        "height_px": VIEW.height,
        "scale_x_m_px": VIEW.scale_x_m,
        "scale_y_m_px": VIEW.scale_y_m,
        "blur_px": 0.7,
    }
    path = tmp_path / "calibration.npz"
    PhotometricModel(
        exponents=np.array([[1, 0, 0, 0, 0]]),
        coefficients=np.array([[30.0, 20.0, 10.0]]),
        provenance=made | provenance,
    ).save(path)
    return str(path)


def test_a_calibration_of_the_sensors_images_is_taken(tmp_path: Path) -> None:
    """Colours and blur come from the file, the view from the sensor's."""
    found = calibrated_optics(_calibration(tmp_path), MINI)
    assert found.blur_px == 0.7
    assert found.geometry == VIEW


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"width_px": 640, "height_px": 480}, r"of images of 640 x 480 px, .* at 320 x 240 px"),
        ({"scale_x_m_px": 2.0 * VIEW.scale_x_m}, r"0.1268 mm per pixel, .* says 0.0634 mm"),
    ],
)
def test_a_calibration_of_other_images_is_refused(
    tmp_path: Path, other: dict[str, object], message: str
) -> None:
    """Raw frames, or another sensor's: both sizes, both scales are named."""
    with pytest.raises(ConfigError, match=message):
        calibrated_optics(_calibration(tmp_path, **other), MINI)


def test_no_calibration_renders_what_cannot_be_calibrated(tmp_path: Path) -> None:
    """A renderer without terms to fit is refused another's colours, and is not fitted in a run."""
    renderer = replace(MINI.optics.renderer, exponents=None)
    sensor = replace(MINI, optics=replace(MINI.optics, renderer=renderer))
    with pytest.raises(ConfigError, match=r"optics\.kind photometric cannot be calibrated"):
        calibrated_optics(_calibration(tmp_path), sensor)

    def calibrate(_sensor: Sensor, _say: Say) -> OpticalCalibration:
        raise AssertionError

    said: list[str] = []
    found = optics_of("", sensor, calibrate=calibrate, on_progress=said.append)
    assert found.model is sensor.optics.model
    assert "not calibrated" in said[0]


def test_a_scale_that_was_measured_anew_is_taken(tmp_path: Path) -> None:
    """A lab's own scale may differ from the file's by a few per cent."""
    given = _calibration(tmp_path, scale_x_m_px=1.02 * VIEW.scale_x_m)
    assert calibrated_optics(given, MINI).geometry == VIEW
