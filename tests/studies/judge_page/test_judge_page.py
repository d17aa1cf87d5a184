"""The page of judgements: what stands in the JSON stands in its tables, losses are named."""

import json
from pathlib import Path

import numpy as np
import pytest

from tacauchy_rig.core.image_codec import encode_png
from tests.studies.judge_page.command import judge_page

SCORE = {
    "key": "contact_relative_residual",
    "label": "Contact residual",
    "heading": "Contact residual",
    "digits": 3,
    "factor": 1.0,
}
MEAN = {"contact_relative_residual": {"mean": 0.125}}


def _simulator(title: str, *, is_ours: bool) -> dict[str, object]:
    return {
        "title": title,
        "is_ours": is_ours,
        "means": MEAN,
        "own_press_wins": 2,
        "own_press_wins_of": 6,
        "milliseconds_an_image": None if is_ours else 12.6,
        "machine": "",
        "note": "A note.",
        "fitted_to_these": not is_ours,
    }


@pytest.fixture
def judged(tmp_path: Path) -> Path:
    """A judgement in which ours loses."""
    content = {
        "provenance": {"name": "dry-run"},
        "tables": {"contact": [SCORE], "frame": [], "mechanics": []},
        "floors": [{"name": "no-contact frame", "means": {}}],
        "ceiling": None,
        "simulators": [_simulator("Ours 1", is_ours=True), _simulator("Other 2", is_ours=False)],
        "contests": [
            {
                "other": "Other 2",
                "score": SCORE,
                "ours": 0.125,
                "theirs": 0.1,
                "is_lost": True,
                "is_clear": False,
            }
        ],
    }
    folder = tmp_path / "judged"
    folder.mkdir()
    (folder / "judged.json").write_text(json.dumps(content))
    (folder / "judged.png").write_bytes(encode_png(np.zeros((50, 2000, 3), dtype=np.uint8)))
    return folder


def test_page_holds_numbers_pictures_and_losses(judged: Path, tmp_path: Path) -> None:
    """Means, times and wins are in the table, a lost score is named."""
    out = tmp_path / "docs/page.md"
    judge_page([judged], out=out)
    text = out.read_text()
    prose = " ".join(text.split())
    assert "| **Ours 1** | 0.125 | 2 of 6 |  |" in text
    assert "| Other 2 | 0.125 | 2 of 6 | 13 |" in text
    assert "loses 1 of 1" in text
    assert "Contact residual against Other 2 (0.125 against 0.100, within the scatter)" in prose
    assert text.count("Fitted to these same presses. A note.") == 1
    assert (out.parent / "images/judged_dry_run.png").exists()
