"""The page of five objects, of made-up presses, and the objects of a run."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib import resources
from pathlib import Path

import pytest

from sim.scene.scene import Preset
from sim.studies.objects.shapes import OBJECTS
from tacauchy_rig.app.cli.studies.objects import objects, objects_page
from tacauchy_rig.app.judging.of_run import references_of
from tacauchy_rig.app.judging.writing import write_outputs
from tacauchy_rig.app.replay.opening import open_run
from tacauchy_rig.app.replay.report import evidence_of
from tacauchy_rig.core.errors import ConfigError, RecordError
from tacauchy_rig.core.outputs import Outputs, PressOutput, Simulator
from tests.recorded_run import new_run, press_run
from tests.sim.made_up_presses import object_presses


def test_page_names_every_press_and_what_is_above_an_object() -> None:
    """One row a press; a pixel above its object is told in micrometres."""
    first, *others = object_presses("one")
    text = objects_page(
        [[replace(first, highest_over_m=2e-6), *others]], command="x", preset=Preset.FAST
    )
    assert "Made by `x`." in text
    rows = [line for line in text.splitlines() if line.startswith("| one |")]
    assert len(rows) == len(OBJECTS)
    assert rows[0] == "| one | bar | 1.500 | 2 | 30 |"
    assert rows[1] == "| one | hexagon | 1.500 | 0 | 30 |"


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


def test_objects_of_a_run_stand_beside_a_simulators(run: Path, tmp_path: Path) -> None:
    """Who shows no contact scores as no contact does, and the figure is written."""
    frames = references_of(evidence_of(open_run(run)))
    presses = {index: PressOutput(image=frame) for index, frame in frames.items()}
    who = Simulator(name="Other", version="3")
    write_outputs(tmp_path / "other", Outputs(simulator=who, presses=presses))
    told = tmp_path / "objects.json"
    objects(out=tmp_path / "out", run=run, ours=tmp_path / "other", json_file=told)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"objects.pdf", "objects.png"}
    found = json.loads(told.read_text())
    assert found["camera"] == "emulated"
    assert found["simulator"] == "Other 3"
    assert [press["trial"] for press in found["presses"]] == [1, 2]
    for press in found["presses"]:
        assert press["indenter"].startswith("cylinder:")
        assert press["scores"] == press["no_contact"]


def test_what_does_not_go_together_is_refused(run: Path, tmp_path: Path) -> None:
    """A run that was not replayed, a page of a run, a simulator without a run."""
    with pytest.raises(RecordError, match="no press has both"):
        objects(out=tmp_path, run=run)
    with pytest.raises(ConfigError, match="five objects"):
        objects(out=tmp_path, run=run, page=tmp_path / "page.md")
    with pytest.raises(ConfigError, match="stands for a run's replay"):
        objects(out=tmp_path, ours=tmp_path)
