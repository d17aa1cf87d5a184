"""A tilted tool through the whole loop: pressed, found, simulated, and worth it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
TARGETS = '["1.5 N", "3 N", "4.5 N"]'
PRESS = (
    "dry-run",
    "--press-only",
    "--set=emulation.seed=41",
    # Preset fast lets an image be 10 % off: it leaves a degree out.
    '--set=emulation.tilt=["-1.6 deg", "1.2 deg"]',
    f"--set=protocol.force_targets={TARGETS}",
    "--set=limits.stale_force=500 ms",
    "--set=limits.stale_robot=500 ms",
    "--set=limits.stale_image=2 s",
    "--set=robot.watchdog=2 Hz",
)


def _run(place: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "tacauchy_rig.app.cli.app", *arguments],
        cwd=place,
        capture_output=True,
        text=True,
        timeout=280,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=False,
    )


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_friction_and_lean_as_found_explain_more_of_the_contact(tmp_path: Path) -> None:
    """Of two degrees, in each trial; the command says so and writes its page."""
    pressed = _run(tmp_path, *PRESS)
    assert pressed.returncode == 0, pressed.stdout + pressed.stderr
    (folder,) = (tmp_path / "runs").iterdir()
    options = ("--preset", "fast", "--drawn", "1", "--out", "page.md", "--json", "found.json")
    checked = _run(tmp_path, "mounting-check", str(folder), *options)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    assert "tilt on: found" in checked.stdout
    residuals = json.loads((tmp_path / "found.json").read_text())["residuals"]
    assert residuals["passed"]
    assert len(residuals["rows"]) == 3
    assert "emulation.tilt" in (tmp_path / "page.md").read_text()
