"""What a configuration says of the replay, checked before anything is pressed."""

from __future__ import annotations

from pathlib import Path

import pytest

from sim.optics.colour.nominal import nominal_photometric
from sim.sensor.optics import Lamp
from sim.sensor.sensor import load_sensor
from tacauchy_rig.config.load import load_config
from tacauchy_rig.config.model import RigConfig
from tacauchy_rig.doctor.result import CheckStatus, checked
from tacauchy_rig.loop.settings import check_optics, check_replay

MOCKED = ("robot.driver=mock", "force_sensor.driver=mock", "camera.driver=mock")


def configured(*overrides: str) -> RigConfig:
    """Return the defaults with ``table.field=value`` overrides."""
    return load_config(overrides=overrides).config


def test_the_line_names_sensor_preset_and_tolerance() -> None:
    """What chooses the preset stands beside it."""
    assert check_replay(configured()).startswith("GelSight Mini, preset balanced, optics")
    assert "for a tolerance of 5% of F_z" in check_replay(configured("replay.tolerance=5%"))


def test_the_line_names_the_calibration(tmp_path: Path) -> None:
    """A file that can be read is named; without one it is said what the images come from."""
    file = tmp_path / "calibration.npz"
    nominal_photometric([Lamp(azimuth_rad=0.0, elevation_rad=0.5, colour=(9.0, 0.0, 0.0))]).save(
        file
    )
    sensor = load_sensor("gelsight-mini")
    given = configured(f"sensor.optics_calibration={file}")
    assert check_optics(given, sensor) == f"optics from {file}"
    assert "emulated sensor" in check_optics(configured(), sensor)
    assert "not calibrated" in check_optics(configured(*MOCKED), sensor)


@pytest.mark.parametrize(
    ("override", "found"),
    [
        ("sensor.optics_calibration=gone.npz", "gone.npz does not exist"),
        ("sensor.name=gelsight-maxi", "gelsight-maxi"),
        ("replay.preset=finest", "'finest' is no preset"),
        ("replay.drive=push", "'push' is no way to reach a force"),
        ("replay.tolerance=1 mm", "replay.tolerance"),
    ],
)
def test_doctor_fails_what_no_replay_is_made_with(override: str, found: str) -> None:
    """Each has its finding and its remedy."""
    config = configured(override)
    result = checked("replay", lambda: check_replay(config))
    assert result.status is CheckStatus.FAIL
    assert found in result.finding
    assert result.remedy
