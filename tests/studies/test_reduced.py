"""Studies in their smallest form, by their command: what they need still works together.

One emulated run of three presses with a tilted tool serves those that take a run. Small forms of
the other studies stand in the folders of the studies.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
TRIALS = 3
PRESS = (
    "--set=emulation.seed=41",
    # Preset fast lets an image be 10 % off: it leaves a degree out.
    '--set=emulation.tilt=["-1.6 deg", "1.2 deg"]',
    '--set=protocol.force_targets=["1.5 N", "3 N", "4.5 N"]',
    "--set=replay.preset=fast",
    "--set=limits.stale_force=500 ms",
    "--set=limits.stale_robot=500 ms",
    "--set=limits.stale_image=2 s",
    "--set=robot.watchdog=2 Hz",
)
pytestmark = [pytest.mark.slow, pytest.mark.timeout(2000)]


def _run(place: Path, module: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", module, *arguments],
        cwd=place,
        capture_output=True,
        text=True,
        timeout=1800,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=False,
    )


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dry run of three presses, replayed and reported."""
    place = tmp_path_factory.mktemp("dry-run")
    done = _run(place, "tacauchy_rig.app.cli.app", "dry-run", *PRESS)
    assert done.returncode in (0, 1), done.stdout + done.stderr
    (folder,) = (place / "runs").iterdir()
    return folder


def study(place: Path, name: str, *arguments: str) -> dict[str, Any]:
    """Run a study; return its JSON. It ends with 0, or with 1 where a criterion is missed."""
    done = _run(
        place, "tests.studies", name, *arguments, "--out", "page.md", "--json", "found.json"
    )
    assert done.returncode in (0, 1), done.stdout + done.stderr
    assert (place / "page.md").read_text("utf-8").startswith("# ")
    found: dict[str, Any] = json.loads((place / "found.json").read_text("utf-8"))
    return {**found, "exit_code": done.returncode}


def test_mounting(recorded: Path, tmp_path: Path) -> None:
    """Friction and tilt as found explain more of the contact, in each of the three presses."""
    found = study(tmp_path, "mounting", str(recorded), "--preset", "fast", "--drawn", "1")
    assert found["residuals"]["passed"]
    assert len(found["residuals"]["rows"]) == TRIALS
    assert "emulation.tilt" in (tmp_path / "page.md").read_text("utf-8")


def test_residual(recorded: Path, tmp_path: Path) -> None:
    """Every planted cause has a row."""
    found = study(tmp_path, "residual", str(recorded), "--draws", "1")
    assert found["planted"]["rows"]


def test_verdict(recorded: Path, tmp_path: Path) -> None:
    """A replay that shows no contact is caught."""
    found = study(tmp_path, "verdict", str(recorded), "--only", "no contact*")
    assert found["wrong"]["passed"]


def test_page(tmp_path: Path) -> None:
    """The page stops a run by button and by key, and a run with a page loses no sample."""
    found = study(tmp_path, "page", "--stops", "2", "--pairs", "2")
    assert all(table["rows"] for table in found["tables"])
