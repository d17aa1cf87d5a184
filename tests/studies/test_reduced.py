"""Studies in their smallest form, by their command: what they need still works together.

A run of three light presses in simulated time, seen coarsely and pressed by a tilted tool, serves
those that take a run; it is replayed truly once. Small forms of the other studies stand in the
folders of the studies.
"""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from reports.scores.residual_causes import Cause
from sim.scene.scene import Preset
from tacauchy_rig.app.replay.open_run import open_run
from tacauchy_rig.core.simulated import ResidualSplit
from tacauchy_rig.core.store.run_store import ReplayFields
from tests.recorded_run import coarse_sensor, new_run, press_run
from tests.studies import __main__ as studies
from tests.studies.residual import command as residual_command
from tests.studies.verdict import bench as bench_module
from tests.studies.verdict.bench import Bench, bench_of
from tests.studies.verdict.command import look_at
from tests.studies.verdict.wrong_models import WRONG_MODELS

ROOT = Path(__file__).resolve().parents[2]
TRIALS = 3
TILT = '["-1.6 deg", "0 deg"]'
RUN = (
    'protocol.force_targets=["1 N", "1.5 N", "2 N"]',
    "replay.preset=fast",
    "replay.pose=stated",
    f"replay.tilt={TILT}",
    f"emulation.tilt={TILT}",
)
pytestmark = pytest.mark.timeout(600)


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """The true replay of three presses, whose images are taken for the recorded ones."""
    place = tmp_path_factory.mktemp("runs")
    store = new_run(place, f'sensor.name="{coarse_sensor(place, 8)}"', *RUN)
    press_run(store)
    with pytest.MonkeyPatch.context() as patched:
        # What uncertain inputs change of the forces takes most of the time, and no test reads it.
        patched.setattr(bench_module, "force_inputs", lambda *_, **__: ())
        found = bench_of(open_run(store.paths.root), preset=Preset.FAST)
    images = {index: ReplayFields(image=image) for index, image in found.images.items()}
    store.save_replay(found.pressed.replay, images)
    return with_own_images(found)


@pytest.fixture
def recorded(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Their run, of which all studies take the one true replay."""
    monkeypatch.setattr(bench_module, "bench_of", lambda *_, **__: bench)
    return bench.run.store.paths.root


def with_own_images(bench: Bench) -> Bench:
    """Return a bench whose recordings show just what its true replay does."""
    trials = []
    for trial in bench.recorded.trials:
        image = bench.images[trial.index]
        assert trial.images is not None
        shown = replace(trial.images, real=image, first_half=image, second_half=image)
        trials.append(replace(trial, images=shown))
    return replace(bench, recorded=replace(bench.recorded, trials=tuple(trials)))


def study(place: Path, name: str, *arguments: str) -> dict[str, Any]:
    """Run a study; return its JSON. It ends with 0, or with 1 where a criterion is missed."""
    page, found = place / "page.md", place / "found.json"
    words = [name, *arguments, "--out", str(page), "--json", str(found)]
    assert studies.app(words, standalone_mode=False) in (0, 1)
    assert page.read_text("utf-8").startswith("# ")
    return dict(json.loads(found.read_text("utf-8")))


def test_mounting(recorded: Path, tmp_path: Path) -> None:
    """Friction and tilt as they are explain more of the contact, in each of the three presses."""
    found = study(tmp_path, "mounting", str(recorded), "--preset", "fast", "--drawn", "1")
    assert found["residuals"]["passed"]
    assert len(found["residuals"]["rows"]) == TRIALS
    assert found["leans"]["rows"]
    assert "emulation.tilt" in (tmp_path / "page.md").read_text("utf-8")


def test_residual(recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run with nothing wrong and one whose cell misreads have a row each.

    Their residuals are not split, which takes half a minute: test_image_causes does that.
    """
    forces_n = []

    def split(parts: Sequence[Any], *_: object, **__: object) -> ResidualSplit:
        forces_n.append([each.record.force_measured_n for _, own in parts for each in own])
        return ResidualSplit(trials=(), shares={cause.value: 0.125 for cause in Cause}, found=())

    monkeypatch.setattr(residual_command, "split_images", split)
    found = study(tmp_path, "residual", str(recorded), "--draws", "1", "--only", "force*")
    assert [row[1] for row in found["planted"]["rows"]] == ["none", "force error"]
    assert forces_n[0] != forces_n[1]


def test_verdict(recorded: Path, tmp_path: Path) -> None:
    """Images of no contact, of another trial, or of two trials exchanged are caught."""
    found = study(tmp_path, "verdict", str(recorded), "--only", "no contact*", "--only", "images*")
    assert found["wrong"]["passed"]
    assert len(found["wrong"]["rows"]) == 3
    assert len(found["true"]["rows"]) == TRIALS


def test_a_press_beside_its_place_is_caught_from_a_size_on(bench: Bench) -> None:
    """Images that are the replay's own show 0.1 mm, and nothing where nothing is wrong."""
    models = {model.name: model for model in WRONG_MODELS}
    beside, unloaded = models["press beside its place"], models["no contact in any image"]
    tasks = [(beside, 0.0), (beside, 0.0125), (beside, 0.1), (unloaded, 0.0)]
    true, near, far, none = (look_at(task, bench=bench).missed for task in tasks)
    assert not {"contact_offset", "contact_residual"} & {*true, *near}, (true, near)
    assert "contact_offset" in far
    assert "contact_residual" in none


def test_sweep_kills(tmp_path: Path) -> None:
    """Killed processes and workers, a new scheduler, tasks at their walltime: no press is lost."""
    pytest.importorskip("distributed")
    found = study(tmp_path, "sweep-kills", "--presses", "12")
    assert found["tables"][0]["passed"]


def test_page(tmp_path: Path) -> None:
    """The page stops a run by button and by key, and a run with a page loses no sample."""
    words = ["page", "--trials", "1", "--stops", "1", "--pairs", "1", "--out", "page.md"]
    done = subprocess.run(
        [sys.executable, "-m", "tests.studies", *words, "--json", "found.json"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=600,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=False,
    )
    assert done.returncode in (0, 1), done.stdout + done.stderr
    assert (tmp_path / "page.md").read_text("utf-8").startswith("# ")
    tables = json.loads((tmp_path / "found.json").read_text("utf-8"))["tables"]
    assert [len(table["rows"]) for table in tables] == [1, 2, 2]
