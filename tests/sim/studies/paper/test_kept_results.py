"""Benchmarks and reports that are kept."""

import json
from pathlib import Path
from typing import Any

import pytest

from sim.studies.paper.kept_results import REPORTS_FILE, SCORES, of_run, read_kept, read_speeds
from tacauchy_rig.core.errors import RecordError


def write(folder: Path, *, environments: tuple[int, ...] = (1, 60)) -> None:
    """Write a benchmark of two scenes, the second half as fast, and a failed one."""
    groups = [
        [
            {"scene": name, "environments": count, "press": press}
            for name, press in (
                ("quick", {"wall_s": 0.1, "parts_s": {"stress": 1e-5}}),
                ("slow", {"wall_s": 0.2, "parts_s": {}}),
                ("failed", None),
            )
        ]
        for count in environments
    ]
    (folder / "h100_scenes.json").write_text(json.dumps({"groups": groups}))


def test_the_slowest_scene_is_taken(tmp_path: Path) -> None:
    """20 frames in 0.2 s, alone and of 60 environments; failed scenes count nowhere."""
    write(tmp_path)
    speeds = read_speeds(tmp_path)
    assert speeds.slowest(1).frames_per_s == pytest.approx(100.0)
    assert speeds.slowest(60).frames_per_s == pytest.approx(6000.0)
    assert speeds.slowest(60).scene == "slow"
    assert len(speeds.of(60)) == 2
    assert speeds.slowest_stress_s() == 1e-5
    assert speeds.cpu_frames_per_s is None


def test_a_folder_without_sixty_environments_is_refused(tmp_path: Path) -> None:
    """The message says what is missing and where it lies."""
    write(tmp_path, environments=(1,))
    with pytest.raises(RecordError, match="60 environments"):
        read_speeds(tmp_path)


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
    assert (found["name"], found["ours"], found["trials"]) == ("a set", {}, [])
    assert found["no_contact"]["ssim"] == 0.5


def test_reports_come_back_as_they_were_kept(tmp_path: Path) -> None:
    """Written as JSON and read, with the forces of its trials."""
    found = of_run(run(tmp_path, summary(simulated=0.75)))
    assert found["trials"][0]["force_n"] == 1.0
    (tmp_path / REPORTS_FILE).write_text(json.dumps([found]))
    assert read_kept(tmp_path) == [found]


def test_a_run_without_a_report_is_refused(tmp_path: Path) -> None:
    """The remedy is the command that writes one."""
    with pytest.raises(RecordError, match=r"summary\.json"):
        of_run(tmp_path)
