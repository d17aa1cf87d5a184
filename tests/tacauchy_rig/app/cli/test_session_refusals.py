"""What a run refuses before anything moves, and how it says so."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tacauchy_rig.app.cli.app import app
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.config.rules import ARM_REQUIRES
from tacauchy_rig.core.errors import AbortedError, ConfigError, RecordError
from tacauchy_rig.core.store.run_store import RunStore

runner = CliRunner()


def refuse(*arguments: str) -> None:
    """Run the command; its error comes out."""
    runner.invoke(app, list(arguments), catch_exceptions=False)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("replay.preset=finest", r"replay\.preset: 'finest' is no preset"),
        ("sensor.name=gelsight-maxi", "gelsight-maxi"),
    ],
)
def test_what_no_replay_is_made_with_is_refused_before_the_presses(
    tmp_path: Path, setting: str, message: str
) -> None:
    """Six presses are not made for a replay that cannot start."""
    with pytest.raises(ConfigError, match=message):
        refuse("dry-run", "--set", setting, "--set", f"run.output_directory={tmp_path}")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("content", [None, b"", b"no calibration"])
def test_lost_calibration_is_refused_before_the_presses(
    tmp_path: Path, content: bytes | None
) -> None:
    """A missing, an empty and a damaged file are named before a run folder is made."""
    file, runs = tmp_path / "calibration.npz", tmp_path / "runs"
    if content is not None:
        file.write_bytes(content)
    settings = [f"sensor.optics_calibration={file}", f"run.output_directory={runs}"]
    with pytest.raises(ConfigError, match=r"calibration\.npz") as caught:
        refuse("dry-run", *(part for text in settings for part in ("--set", text)))
    assert "tacauchy-rig calibrate optics" in caught.value.remedy
    assert not runs.exists()


@pytest.mark.parametrize("command", ["replay", "resume"])
def test_lost_calibration_of_a_recorded_run_is_told_at_once(tmp_path: Path, command: str) -> None:
    """Neither the simulation nor the missing presses come first."""
    loaded = load_config(overrides=[f"sensor.optics_calibration={tmp_path / 'gone.npz'}"])
    store = RunStore.create(tmp_path, loaded, config_text="", simulated=True, versions={})
    with pytest.raises(ConfigError, match=r"gone\.npz does not exist"):
        refuse(command, str(store.paths.root))
    assert not list(store.paths.root.glob("trials/*/*"))


def test_dry_run_never_moves_a_real_arm(tmp_path: Path) -> None:
    """robot.driver = "ur5" belongs to ``run``."""
    settings = ["robot.driver=ur5", "robot.host=192.0.2.1", f"run.output_directory={tmp_path}"]
    written = load_config().written
    settings += [f"{field}={json.dumps(written[field])}" for field in ARM_REQUIRES]
    with pytest.raises(AbortedError, match="never moves a real arm"):
        refuse("dry-run", *(part for text in settings for part in ("--set", text)))


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_folder_without_permission_is_named(tmp_path: Path) -> None:
    """The folder and what to do stand in the message."""
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o500)
    with pytest.raises(RecordError, match="closed"):
        refuse("dry-run", "--set", f"run.output_directory={closed}")


def test_output_folder_that_is_a_file_is_named(tmp_path: Path) -> None:
    """A file in the way is no fault of the program."""
    (tmp_path / "runs").write_text("")
    with pytest.raises(RecordError, match="runs"):
        refuse("dry-run", "--set", f"run.output_directory={tmp_path / 'runs'}")


def test_a_lost_calibration_fails_with_what_to_do(tmp_path: Path) -> None:
    """The replay is looked at like a device: what would fail after the presses fails here."""
    settings = ["--set", "sensor.optics_calibration=gone.npz"]
    settings += ["--set", f"run.output_directory={tmp_path}"]
    done = CliRunner().invoke(app, ["doctor", "--host-only", *settings])
    assert done.exit_code == 1
    assert "FAIL  replay: optics calibration gone.npz does not exist" in done.stdout
    assert "-> write one with: tacauchy-rig calibrate optics" in done.stdout
