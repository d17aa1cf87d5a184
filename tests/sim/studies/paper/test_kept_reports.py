"""Scores of reports, kept beside the benchmarks."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from sim.studies.paper.kept import REPORTS_FILE, SCORES, json_lines, of_run, read_kept
from tacauchy_rig.core.errors import RecordError


def summary(*, simulated: float | None) -> dict[str, Any]:
    """Return a report's summary of one press, its images simulated or not."""
    scores = dict.fromkeys(SCORES, simulated)
    return {
        "simulated": False,
        "imported": True,
        "optics": None,
        "model": {},
        "provenance": {
            "versions": {"tacauchy-rig": "1"},
            "created": "2026-11-23T10:00:00",
            "imported": {"source": "a set"},
        },
        "statistics": {
            "no_contact": {score: {"mean": 0.5, "count": 1} for score in SCORES},
            "metrics": {score: {"mean": simulated, "count": 1} for score in SCORES},
        },
        "trials": [{"force_measured_n": 1.0, "metrics": scores}],
    }


def run(folder: Path, content: dict[str, Any]) -> Path:
    """Return a run folder with this summary."""
    (folder / "report").mkdir()
    (folder / "report" / "summary.json").write_text(json.dumps(content))
    return folder


def test_a_set_without_simulated_images_has_its_floor(tmp_path: Path) -> None:
    """Nothing of ours, no trials, and the scores of no contact."""
    found = of_run(run(tmp_path, summary(simulated=None)))
    assert (found.name, found.ours, found.trials) == ("a set", {}, ())
    assert found.no_contact["ssim"] == 0.5


def test_reports_come_back_as_they_were_kept(tmp_path: Path) -> None:
    """Written as JSON and read, with the forces of its trials."""
    found = of_run(run(tmp_path, summary(simulated=0.75)))
    assert found.trials[0]["force_n"] == 1.0
    (tmp_path / REPORTS_FILE).write_text(json_lines([found]))
    assert read_kept(tmp_path) == [found]


def test_a_run_without_a_report_is_refused(tmp_path: Path) -> None:
    """The remedy is the command that writes one."""
    with pytest.raises(RecordError, match=r"summary\.json"):
        of_run(tmp_path)


def test_a_run_without_images_is_refused(tmp_path: Path) -> None:
    """A floor needs images."""
    content = summary(simulated=None)
    for row in content["statistics"]["no_contact"].values():
        row["mean"] = None
    with pytest.raises(RecordError, match="images"):
        of_run(run(tmp_path, content))
