"""The examples of docs/python.md, run as they stand there."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest

from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.run import JournalEvent
from tacauchy_rig.core.store.journal import append_event
from tacauchy_rig.core.store.run_store import RunStore
from tests.reports import conftest as made
from tests.reports.conftest import FORCE_N, record, write_recording

PAGE = (Path(__file__).parents[1] / "docs" / "python.md").read_text("utf-8")
EXAMPLES = dict(re.findall(r"^## ([^\n]*)\n\n```python\n(.*?)```", PAGE, re.DOTALL | re.M))
LINES_MOST = 15
SETTINGS = ("replay.preset=fast", f'protocol.force_targets=["{FORCE_N} N"]')


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recorded run of one press where the page has it."""
    place = tmp_path_factory.mktemp("notebook")
    mocked = [f"{device}.driver=mock" for device in ("robot", "force_sensor", "camera")]
    loaded = load_config(overrides=[*SETTINGS, *mocked])
    store = RunStore.create(place, loaded, config_text="", simulated=True, versions={})
    recording = store.paths.recording(1, 1)
    recording.parent.mkdir(parents=True)
    write_recording(recording, made)
    store.save_result(record(1))
    append_event(store.paths.journal, JournalEvent(stamp_ns=1, name="run-start"))
    (place / "runs").mkdir()
    store.paths.root.rename(place / "runs" / "20260102-030405-lab")
    return place


def run(title: str, place: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Run an example in a folder, and return what it leaves."""
    monkeypatch.chdir(place)
    mpl.use("agg")
    names: dict[str, Any] = {}
    exec(compile(EXAMPLES[title], title, "exec"), names)  # noqa: S102 - our own page
    return names


def test_examples_are_short() -> None:
    """Four of them, none longer than a screen's half."""
    lines = {title: len(re.findall(r"\S.*\n", code)) for title, code in EXAMPLES.items()}
    assert len(lines) == 4
    assert max(lines.values()) <= LINES_MOST


def test_a_ball_presses_hardest_in_its_middle(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The pressure is that of Hertz: highest at the axis, zero outside the contact."""
    names = run("Press a ball and plot its pressure", place, monkeypatch)
    radius = np.hypot(names["x"], names["y"])
    pressure, edge = names["pressure"], names["result"].contact_radius_m
    assert radius[np.argmax(pressure)] < 0.5 * edge
    assert pressure[radius > 1.2 * edge].max() < 0.02 * pressure.max()
    assert (place / "pressure.png").exists()


def test_a_recorded_run_is_read_replayed_and_scored(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The three examples on a run, in the order of the page."""
    attempt = run("Open a run", place, monkeypatch)["attempt"]
    assert attempt.force_curve.value[attempt.force_curve.time_s > 0.0] == pytest.approx(FORCE_N)
    (trial,) = run("Replay it", place, monkeypatch)["replay"].trials
    assert trial.force_simulated_n == pytest.approx(FORCE_N, abs=0.01)
    names = run("Score two images with floors", place, monkeypatch)
    assert names["scores"].ssim > names["floors"].flat_mean.ssim
