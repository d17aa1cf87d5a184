"""The page of what accuracy costs, made of what ``accuracy`` left in a folder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from sim.studies.accuracy.study import QUANTITIES
from tacauchy_rig.app.cli.studies.accuracy import PROMISES, study_name, write_page
from tacauchy_rig.core.errors import RecordError


def _section(title: str) -> dict[str, Any]:
    return {
        "title": title,
        "columns": ["settings", "F_z [%]"],
        "rows": [["fast", 1.5]],
        "criterion": "it is small",
        "passed": True,
        "note": "",
        "command": "tacauchy-rig accuracy",
    }


def _study(seed: int, error: float) -> dict[str, Any]:
    return {
        "seed": seed,
        "reference_error_bars": dict.fromkeys(QUANTITIES, 0.001),
        "rows": [
            {
                "configuration": {"name": "fast"},
                "errors": dict.fromkeys(QUANTITIES, error),
                "chances": dict.fromkeys(QUANTITIES, 0.005),
            },
            {"configuration": {"name": "failed"}, "errors": {}, "chances": {}},
        ],
        "section": _section("Error against time"),
    }


def _fill(folder: Path) -> None:
    folder.mkdir()
    (folder / "accuracy.png").write_bytes(b"picture")
    files = {
        study_name(0): _study(0, 0.02),
        study_name(1): _study(1, 0.021),
        Path(PROMISES).stem: {"section": _section("What a tolerance promises")},
    }
    for name, content in files.items():
        (folder / f"{name}.json").write_text(json.dumps(content), "utf-8")


def test_the_page_has_all_that_the_folder_has(tmp_path: Path) -> None:
    """The study, the seeds' comparison, the promises; the figure beside it."""
    _fill(tmp_path / "found")
    page, image = write_page(tmp_path / "docs" / "accuracy.md", tmp_path / "found")
    text = page.read_text("utf-8")
    for title in (
        "Error against time",
        "The same on other meshes",
        "What a tolerance promises",
    ):
        assert f"## {title}" in text
    assert "every criterion is met" in text
    assert "6 of 6 errors" in text
    assert "tacauchy-rig accuracy --seed 1" in text
    assert image.read_bytes() == b"picture"
    assert f"({image.parent.name}/{image.name})" in text


def test_a_page_needs_a_study(tmp_path: Path) -> None:
    """Without one the error says which command makes it."""
    with pytest.raises(RecordError, match="cannot be read") as refused:
        write_page(tmp_path / "accuracy.md", tmp_path)
    assert "tacauchy-rig accuracy" in refused.value.remedy
