"""``doctor`` as an operator calls it."""

from __future__ import annotations

from pathlib import Path

from typer.testing import CliRunner

from tacauchy_rig.app.cli.app import app


def test_a_lost_calibration_fails_with_what_to_do(tmp_path: Path) -> None:
    """The replay is looked at like a device: what would fail after the presses fails here."""
    settings = ["--set", "sensor.optics_calibration=gone.npz"]
    settings += ["--set", f"run.output_directory={tmp_path}"]
    done = CliRunner().invoke(app, ["doctor", "--host-only", *settings])
    assert done.exit_code == 1
    assert "FAIL  replay: optics calibration gone.npz does not exist" in done.stdout
    assert "-> write one with: tacauchy-rig calibrate optics" in done.stdout
