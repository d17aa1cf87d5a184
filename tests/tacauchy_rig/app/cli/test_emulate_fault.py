"""``tacauchy-rig emulate fault`` and ``presses``."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from drivers.emulators.faults import FAULTS_OF_DEVICE, Device, FaultKind
from drivers.emulators.process import DeviceSettings, Service
from tacauchy_rig.app.cli.app import app
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.errors import ConfigError


def _run(*words: object) -> str:
    result = CliRunner().invoke(app, ["emulate", *map(str, words)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def test_a_running_device_is_told_of_a_fault(tmp_path: Path) -> None:
    """It hears what was told, which is written as JSON; a fault that nobody knows is refused."""
    service = Service(
        DeviceSettings(folder=tmp_path, config=load_config().config), Device.FORCE_SENSOR
    )
    words = ["--json", tmp_path / "told.json"]
    try:
        _run("fault", tmp_path, "force_sensor:freeze@1s+2s", *words)
        assert service.faults_at(0.0) == []
        (heard,) = service.faults_at(1.0)
    finally:
        service.close()
    assert (heard.kind, heard.start_s, heard.duration_s) == (FaultKind.FREEZE, 1.0, 2.0)
    assert json.loads((tmp_path / "told.json").read_text())["fault"] == "force_sensor:freeze@1s+2s"
    with pytest.raises(ConfigError, match="melt"):
        _run("fault", tmp_path, "force_sensor:melt@1s")


def test_the_help_names_every_kind() -> None:
    """An operator finds there what can be asked of which device."""
    shown = _run("fault", "--help")
    for device, kinds in FAULTS_OF_DEVICE.items():
        assert f"{device}:" in shown
        assert all(kind.value in shown for kind in kinds)


def test_presses_without_noise_say_what_the_noise_is(tmp_path: Path) -> None:
    """Images are numbered from --first on; the JSON has the noise that was left out."""
    shown = _run(
        *("presses", "--out", tmp_path / "check", "--count", 5, "--first", 41, "--noise-free"),
        *("--json", tmp_path / "check.json"),
    )
    assert "5 presses of a 4.70 mm ball on an emulated GelSight Mini" in shown
    assert "--scale 15.77,15.77px/mm" in shown
    names = sorted(path.name for path in (tmp_path / "check").glob("press-*.png"))
    assert names == [f"press-{number}.png" for number in range(41, 46)]
    found = json.loads((tmp_path / "check.json").read_text())
    assert found["first"] == 41
    assert 0.0 < found["left_out"]["noise"] < found["left_out"]["recorded"]
    assert f"{found['left_out']['noise']:.2f} grey levels" in shown


def test_recorded_presses_leave_nothing_out(tmp_path: Path) -> None:
    """With noise there is nothing to say of it."""
    shown = _run("presses", "--out", tmp_path / "presses", "--count", 5)
    assert "left out" not in shown
    assert (tmp_path / "presses" / "circles.csv").read_text().count("press-") == 5
