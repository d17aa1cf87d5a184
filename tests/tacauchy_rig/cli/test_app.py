"""The program as a process: exit codes and messages."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tacauchy_rig.cli.app import app

ROOT = Path(__file__).resolve().parents[3]


def call(*arguments: str, cwd: Path, stdin: str = "") -> subprocess.CompletedProcess[str]:
    """Run ``tacauchy-rig`` as an operator does."""
    return subprocess.run(
        [sys.executable, "-m", "tacauchy_rig.cli.app", *arguments],
        cwd=cwd,
        input=stdin,
        capture_output=True,
        text=True,
        timeout=100,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=False,
    )


def test_an_error_is_two_lines_and_status_2(tmp_path: Path) -> None:
    """No traceback reaches a person who did not ask for it."""
    done = call("report", "nowhere", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("error: nowhere: not a run folder")
    assert "->" in done.stderr
    assert "Traceback" not in done.stderr


def test_debug_shows_the_traceback(tmp_path: Path) -> None:
    """``--debug`` is for those who want it."""
    done = call("--debug", "report", "nowhere", cwd=tmp_path)
    assert done.returncode != 0
    assert "Traceback" in done.stderr


def test_unknown_key_names_field_and_remedy(tmp_path: Path) -> None:
    """A misspelt key is refused before anything is made."""
    (tmp_path / "rig.toml").write_text('[robot]\npress_spead = "0.2 mm/s"\n')
    done = call("run", "rig.toml", cwd=tmp_path)
    assert done.returncode == 2
    assert "robot.press_spead" in done.stderr
    assert not (tmp_path / "runs").exists()


def test_nothing_moves_without_the_sensors_name(tmp_path: Path) -> None:
    """A real arm's run shows what will move and stops at a wrong answer, with status 3."""
    assert call("config", "example", "rig.toml", cwd=tmp_path).returncode == 0
    filled_in = {
        "force_sensor.port": "/dev/ttyUSB0",
        "force_sensor.calibration_sheet": "no. 7 of 2026-01-01",
        "sensor.optics_calibration": "",
    }
    settings = [f"--set={field}={value}" for field, value in filled_in.items()]
    done = call("run", "rig.toml", *settings, cwd=tmp_path, stdin="yes\n")
    assert done.returncode == 3
    assert "Type the sensor's name" in done.stdout
    assert "nothing moved" in done.stderr


@pytest.mark.parametrize("command", ["dry-run", "run", "doctor", "press", "emulate", "fault-table"])
def test_every_command_has_help(command: str) -> None:
    """Help costs no device."""
    assert CliRunner().invoke(app, [command, "--help"]).exit_code == 0
