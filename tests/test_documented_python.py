"""The Python examples of the documentation, run as they are printed."""

import re
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest

from tacauchy_rig.app.replay import replay
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.run import JournalEvent
from tacauchy_rig.core.store.journal import append_event
from tacauchy_rig.core.store.run_store import RunStore
from tests.reports import conftest as made
from tests.reports.conftest import FORCE_N, record, write_recording

DOCS = Path(__file__).parents[1] / "docs"
LINES_MOST = 15


def examples(page: str) -> dict[str, str]:
    """Return the first Python block of each section, by the section's title."""
    text = (DOCS / page).read_text("utf-8")
    sections = re.findall(r"^## ([^\n]*)\n(.*?)(?=^## |\Z)", text, re.DOTALL | re.M)
    found = {title: re.search(r"```python\n(.*?)```", body, re.DOTALL) for title, body in sections}
    return {title: block.group(1) for title, block in found.items() if block}


LESSON = examples("tutorials/first-press-in-python.md")
RUNS = examples("how-to/use-from-python.md")
SETTINGS = ("replay.preset=fast", f'protocol.force_targets=["{FORCE_N} N"]')


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recorded run of one press where the page has it."""
    place = tmp_path_factory.mktemp("notebook")
    loaded = load_config(overrides=SETTINGS)
    store = RunStore.create(place, loaded, config_text="", simulated=True, versions={})
    recording = store.paths.recording(1, 1)
    recording.parent.mkdir(parents=True)
    write_recording(recording, made)
    store.save_result(record(1))
    append_event(store.paths.journal, JournalEvent(stamp_ns=1, name="run-start"))
    (place / "runs").mkdir()
    store.paths.root.rename(place / "runs" / "20260102-030405-lab")
    return place


def run(code: str, names: dict[str, Any]) -> dict[str, Any]:
    """Run an example, and return what it leaves."""
    mpl.use("agg")
    exec(compile(code, "documentation", "exec"), names)  # noqa: S102 - our own page
    return names


def test_examples_are_short() -> None:
    """Four in the lesson, three on runs, none longer than half a screen."""
    assert len(LESSON) == 4
    assert len(RUNS) == 3
    lines = [len(re.findall(r"\S.*\n", code)) for code in (*LESSON.values(), *RUNS.values())]
    assert max(lines) <= LINES_MOST


def test_the_lesson_gives_what_it_prints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The printed force; the pressure of Hertz: highest at the axis, zero outside the contact."""
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for code in LESSON.values():
        run(code, names)
    text = (DOCS / "tutorials/first-press-in-python.md").read_text("utf-8")
    assert capsys.readouterr().out.splitlines()[0] in text
    radius = np.hypot(names["x"], names["y"])
    pressure, edge = names["pressure"], names["result"].contact_radius_m
    assert radius[np.argmax(pressure)] < 0.5 * edge
    assert pressure[radius > 1.2 * edge].max() < 0.02 * pressure.max()
    assert (tmp_path / "pressure.png").exists()
    assert names["to_force"].force_n[2] == pytest.approx(1.0, rel=1e-3)
    assert 0.0 < names["soft"].force_n[2] < names["result"].force_n[2]


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_recorded_run_is_read_replayed_and_scored(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The three examples on a run, in the order of the page."""
    monkeypatch.chdir(place)
    # The coarse presses that tell uncertainties take most of the time, and no example shows them.
    monkeypatch.setattr(
        replay, "_uncertainties", lambda _run, parts, *_: ([() for _ in parts], None)
    )
    attempt = run(RUNS["Open a run"], {})["attempt"]
    assert attempt.force_curve.value[attempt.force_curve.time_s > 0.0] == pytest.approx(FORCE_N)
    trial = run(RUNS["Replay it"], {})["trial"]
    assert trial.force_simulated_n == pytest.approx(FORCE_N, abs=0.01)
    names = run(RUNS["Score two images with floors"], {})
    assert names["scores"].ssim > names["floors"].flat_mean.ssim
