"""One press through the whole loop: emulated hardware, protocol, replay, report."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tacauchy_rig.core.store.check.run_and_press_check import check_run
from tacauchy_rig.core.store.run_store import RunStore
from tests.recorded_run import coarse_sensor

ROOT = Path(__file__).resolve().parent.parent


def dry_run(place: Path, model: str, *options: str) -> Path:
    """Run the program as an operator does, with one short press; return the run's folder.

    Images of half the width take a quarter of the time to calibrate and to score.
    """
    settings = {
        "sensor.name": str(coarse_sensor(place, 2)),
        "robot.model": model,
        "robot.home": '["0 mm", "-400 mm", "210 mm"]',
        "robot.search_speed": "1 mm/s",
        "robot.press_speed": "0.5 mm/s",
        "robot.watchdog": "2 Hz",
        "limits.stale_force": "500 ms",
        "limits.stale_robot": "500 ms",
        "limits.stale_image": "2 s",
        "protocol.force_targets": '["2.0 N"]',
        "protocol.air_press_height": "5 mm",
        "protocol.tare_duration": "0.5 s",
        "replay.preset": "fast",
    }
    arguments = [f"--set={field}={value}" for field, value in settings.items()]
    done = subprocess.run(
        [sys.executable, "-m", "tacauchy_rig.app.cli.app", "dry-run", *arguments, *options],
        cwd=place,
        capture_output=True,
        text=True,
        timeout=480,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return next((place / "runs").iterdir())


@pytest.fixture(scope="module")
def finished_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with an arm that hardly feels, from the press to the report."""
    return dry_run(tmp_path_factory.mktemp("cb3"), "cb3")


@pytest.mark.timeout(500)
def test_force_is_measured_replayed_and_reported(finished_run: Path) -> None:
    """The press meets its target, the replay meets the press, and the report says so."""
    summary = json.loads((finished_run / "report" / "summary.json").read_text())
    assert summary["simulated"] is True
    assert summary["passed"] is True
    (trial,) = summary["trials"]
    assert abs(trial["force_measured_n"] - trial["force_target_n"]) <= 0.03
    assert abs(trial["force_simulated_n"] - trial["force_measured_n"]) <= 0.08
    assert trial["depth_simulated_m"] > 1e-4
    assert set(trial["metrics"]) >= {"ssim", "ncc", "histogram_correlation", "psnr_db", "mse"}
    assert trial["metrics"]["mse"] < trial["floors"]["no_contact"]["mse"]
    assert summary["provenance"]["config_hash"]
    (settled,) = [c for c in trial["criteria"] if c["name"] == "settled_images"]
    assert 0.0 <= settled["measured"] < 0.05


@pytest.mark.timeout(500)
def test_an_arm_that_hardly_feels_has_its_cell_weighed(finished_run: Path) -> None:
    """A CB3 asks for a known weight, which an emulated cell hangs on itself."""
    summary = json.loads((finished_run / "report" / "summary.json").read_text())
    assert summary["force_check"]["passed"] is True
    assert "Force checked on" in summary["verdict"]


@pytest.mark.timeout(500)
def test_the_real_clients_recorded_it(finished_run: Path) -> None:
    """ur_rtde, pyserial and OpenCV answered for the devices; nothing claims to be real hardware."""
    devices = json.loads((finished_run / "run.json").read_text())["devices"]
    assert {name: device["driver"] for name, device in devices.items()} == {
        "robot": "ur5",
        "force_sensor": "m3733c",
        "camera": "uvc",
    }
    assert all(device["simulated"] for device in devices.values())


@pytest.mark.timeout(500)
def test_the_truth_is_recovered(finished_run: Path) -> None:
    """The measured force is the emulated world's own within noise and drift."""
    summary = json.loads((finished_run / "report" / "summary.json").read_text())
    forces = [row for row in summary["truth"] if "force" in row["name"] and row["trial"] == 1]
    assert forces
    assert all(abs(row["recovered"] - row["true"]) < 0.06 for row in forces)


@pytest.mark.slow
@pytest.mark.timeout(500)
def test_an_e_series_presses_without_a_weight(tmp_path: Path) -> None:
    """It feels its tool: nothing is hung on the cell before. What is replayed is a CB3's press."""
    store = RunStore.open(dry_run(tmp_path, "e-series", "--press-only"))
    record = store.accepted(1)
    assert record is not None
    assert record.force_measured_n == pytest.approx(2.0, abs=0.03)
    assert store.description["devices"]["robot"]["driver"] == "ur5"
    assert store.force_check.load() is None
    assert check_run(store).passed, list(check_run(store).missed())
