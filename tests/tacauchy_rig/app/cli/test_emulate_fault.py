"""``tacauchy-rig emulate fault``."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from drivers.emulators.faults import FAULTS_OF_DEVICE, Device, FaultKind
from drivers.emulators.process import FaultInbox
from tacauchy_rig.app.cli.app import app
from tacauchy_rig.core.errors import ConfigError


def _run(*words: object) -> str:
    result = CliRunner().invoke(app, ["emulate", *map(str, words)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def test_a_running_device_is_told_of_a_fault(tmp_path: Path) -> None:
    """It hears what was told, which is written as JSON; a fault that nobody knows is refused."""
    inbox = FaultInbox(tmp_path, Device.FORCE_SENSOR)
    words = ["--json", tmp_path / "told.json"]
    try:
        _run("fault", tmp_path, "force_sensor:freeze@1s+2s", *words)
        (heard,) = inbox.poll()
    finally:
        inbox.close()
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


def test_it_waits_for_no_simulator() -> None:
    """It arrives promptly because nothing heavy is imported on its way."""
    program = (
        "import sys; from typer.testing import CliRunner\n"
        "from tacauchy_rig.app.cli.app import app\n"
        "result = CliRunner().invoke(app, ['emulate', 'fault', '--help'])\n"
        "assert result.exit_code == 0, result.output\n"
        "print(*({'warp', 'scipy', 'matplotlib', 'vtk', 'cv2'} & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, "", "")
