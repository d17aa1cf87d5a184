"""Which calibration a run's images are rendered with."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim.optics.render.photometric.model import PhotometricModel
from sim.optics.sensor_camera import camera_geometry
from sim.sensor.sensor import load_sensor
from tacauchy_rig.config.load import load_config
from tacauchy_rig.errors import ConfigError
from tacauchy_rig.loop.optics import optics_of
from tacauchy_rig.store.run_store import RunStore

MINI = load_sensor("gelsight-mini")
VIEW = camera_geometry(MINI)


def _store(tmp_path: Path, **provenance: object) -> RunStore:
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
    loaded = load_config(None, overrides=[f"sensor.optics_calibration={path}"])
    return RunStore.create(tmp_path, loaded, config_text="", simulated=False, versions={})


def test_a_calibration_of_the_sensors_images_is_taken(tmp_path: Path) -> None:
    """Colours and blur come from the file, the view from the sensor's."""
    found = optics_of(_store(tmp_path), MINI, VIEW)
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
        optics_of(_store(tmp_path, **other), MINI, VIEW)


def test_a_scale_that_was_measured_anew_is_taken(tmp_path: Path) -> None:
    """A lab's own scale may differ from the file's by a few per cent."""
    store = _store(tmp_path, scale_x_m_px=1.02 * VIEW.scale_x_m)
    assert optics_of(store, MINI, replace(VIEW)).geometry == VIEW
