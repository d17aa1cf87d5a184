"""``judge`` on a recorded run: its task, a simulator's folder made from it, and the page."""

import csv
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tacauchy_rig.app.cli.import_and_judge import Baseline, judge
from tacauchy_rig.app.judging.task_and_baseline import write_outputs
from tacauchy_rig.core.errors import ConfigError, RecordError
from tacauchy_rig.core.image_codec import decode_rgb
from tacauchy_rig.core.simulated import Driven, Outputs, PressOutput, Simulator
from tests.recorded_run import new_run, press_run


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two presses of the mock rig, whose frames are small, not replayed."""
    parent = tmp_path_factory.mktemp("runs")
    given = resources.files("sim.sensor.files").joinpath("gelsight-mini.toml").read_text()
    small = given.replace("width = 320", "width = 44").replace("height = 240", "height = 33")
    (parent / "small.toml").write_text(small)
    store = new_run(parent, f'sensor.name="{parent / "small.toml"}"')
    press_run(store)
    return store.paths.root


@pytest.fixture(scope="module")
def task(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the run asks."""
    folder = tmp_path_factory.mktemp("task")
    judge(run=run, out=folder, is_task=True)
    return folder


def _theirs(task: Path, folder: Path, *, name: str = "Other") -> Path:
    """Write what a simulator shows that knows nothing but the task: no contact, the force asked."""
    with (task / "presses.csv").open() as lines:
        asked = list(csv.DictReader(lines))
    presses = {
        int(row["press"]): PressOutput(
            image=decode_rgb((task / f"{int(row['press']):02d}/no_contact.png").read_bytes()),
            force_n=1.1 * float(row["force_n"]),
        )
        for row in asked
    }
    who = Simulator(name=name, version="3", driven_by=Driven.DEPTH)
    write_outputs(folder, Outputs(simulator=who, presses=presses))
    return folder


def test_task_says_what_a_simulator_needs(task: Path) -> None:
    """Scale, indenter, force, depth and place are there, and no image of a press."""
    told = tomllib.loads((task / "task.toml").read_text())
    assert told["sensor"].endswith("small.toml")
    assert 1e-5 < told["scale_x_m_px"] < 1e-4
    with (task / "presses.csv").open() as lines:
        rows = list(csv.DictReader(lines))
    assert [row["press"] for row in rows] == ["1", "2"]
    assert float(rows[1]["force_n"]) == pytest.approx(2.0, abs=0.1)
    assert 0.0 < float(rows[0]["depth_m"]) < float(rows[1]["depth_m"])
    assert rows[0]["indenter"].startswith("cylinder:diameter=5mm")
    image = decode_rgb((task / "01/no_contact.png").read_bytes())
    assert image is not None
    assert image.shape == (told["height_px"], told["width_px"], 3)
    assert not list(task.rglob("image.png"))


def judged(**given: Any) -> Any:
    """Return what ``--json`` would hold."""
    found = judge(**given)
    assert found is not None
    return found.content


def test_a_simulator_that_shows_no_contact_is_the_floor(
    run: Path, task: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its scores are the no-contact floor's, and its forces are off by what was added to them."""
    theirs = _theirs(task, tmp_path / "theirs")
    found = judged(run=run, out=tmp_path / "judged", folders=[theirs])
    (other,) = found["simulators"]
    assert other["means"]["ssim"] == found["floors"][0]["means"]["ssim"]
    assert other["means"]["force_error_relative"]["mean"] == pytest.approx(0.1)
    assert "has no replay" in capsys.readouterr().err
    assert (tmp_path / "judged/judged.html").exists()


def test_outputs_can_stand_for_ours(run: Path, task: Path, tmp_path: Path) -> None:
    """A folder named as ours is set against the others."""
    ours = _theirs(task, tmp_path / "ours", name="Ours")
    theirs = _theirs(task, tmp_path / "theirs")
    found = judged(run=run, out=tmp_path / "judged", folders=[theirs], ours_folder=ours)
    assert [each["is_ours"] for each in found["simulators"]] == [True, False]
    assert not any(each["is_lost"] for each in found["contests"])
    assert np.allclose([each["difference"]["mean"] for each in found["contests"]], 0.0)


def test_no_folder_and_one_twice_are_refused(run: Path, task: Path, tmp_path: Path) -> None:
    """Without a folder, or with two of one name, nothing is judged."""
    with pytest.raises(ConfigError, match="nothing to judge"):
        judge(run=run, out=tmp_path / "judged")
    theirs = _theirs(task, tmp_path / "theirs")
    with pytest.raises(ConfigError, match="both of Other 3"):
        judge(run=run, out=tmp_path / "judged", folders=[theirs, theirs])


def test_a_baseline_is_written_and_judged(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The indenter's shape, cut into the gel: its files are written, then judged as others are."""
    # Nominal optics: calibrating those of the emulated camera takes most of a minute.
    monkeypatch.setattr(
        "tacauchy_rig.app.cli.emulated_calibration.emulated_calibration", lambda _: None
    )
    (rigid,) = judged(run=run, out=tmp_path, baselines=[Baseline.RIGID])["simulators"]
    assert rigid["name"] == "rigid penetration"
    assert {path.name for path in (tmp_path / "rigid").iterdir()} >= {"01", "02", "simulator.toml"}
    with pytest.raises(RecordError, match="is not empty"):
        judge(run=run, out=tmp_path, baselines=[Baseline.RIGID])
