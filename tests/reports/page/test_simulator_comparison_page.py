"""The page of a judgement: whole, without links, and what was said of a simulator is text."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from reports.comparison.simulator_comparison import judge
from reports.evidence.evidence_types import RunEvidence
from reports.page.simulator_comparison_page import JudgedPaths, write_judgement
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.simulated import Driven, Outputs, PressOutput, Simulator
from tests.reports.replay_outputs import replay_outputs


@pytest.fixture(scope="module")
def judgement(evidence: RunEvidence):  # type: ignore[no-untyped-def]
    """Ours beside one whose words are markup and whose pressures are not its forces."""
    two = replace(evidence, trials=evidence.trials[:2])
    shape = two.trials[0].images.real.shape[:2]
    presses = {
        t.index: PressOutput(
            image=t.images.reference, force_n=1.0, pressure_pa=np.full(shape, 10.0)
        )
        for t in two.trials[:1]
    }
    who = Simulator(
        name="<b>Bold</b>", version="1", driven_by=Driven.DEPTH, note="<script>", machine="here"
    )
    ours = replay_outputs(two)
    return judge(two, [Outputs(simulator=who, presses=presses, left_out=(2,))], ours=ours)


@pytest.fixture(scope="module")
def written(judgement, tmp_path_factory: pytest.TempPathFactory) -> JudgedPaths:  # type: ignore[no-untyped-def]
    """Its files."""
    folder = tmp_path_factory.mktemp("judged")
    return write_judgement(judgement, folder)


def test_page_says_what_counts(written: JudgedPaths) -> None:
    """Floors, ceiling, who lost, what was left out and what disagrees stand on the page."""
    html = written.html.read_text("utf-8")
    for text in (
        "floor: no-contact frame",
        "ceiling: noise",
        "ours wins",
        "Not simulated: presses 2",
        "its pressures and forces disagree",
        "1 of 2",
        "SIMULATED",
        "not stated",
    ):
        assert text in html
    assert "<script>" not in html
    assert "<b>Bold</b>" not in html
    # Letters of a picture may spell anything.
    words = re.sub(r"data:image/png;base64,[A-Za-z0-9+/=]+", "", html)
    assert "http" not in words.replace("http-equiv", "")


def test_json_holds_every_number(written: JudgedPaths) -> None:
    """The JSON is JSON, has both simulators, and no image."""
    content = json.loads(written.json.read_text("utf-8"))
    assert [s["is_ours"] for s in content["simulators"]] == [True, False]
    assert content["simulators"][1]["left_out"] == [2]
    assert content["simulators"][1]["means"]["contact_relative_residual"]["mean"] == 1.0
    assert written.json.stat().st_size < 100_000


def test_unwritable_folder_is_named(judgement, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    """A file where the folder should be ends with its name and what to do."""
    place = tmp_path / "file"
    place.write_text("here")
    with pytest.raises(RecordError, match="file"):
        write_judgement(judgement, place)
