"""Frames a second from kept benchmarks."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from sim.studies.paper.kept import read_speeds
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
    (folder / "h200_made_up.json").write_text(json.dumps({"groups": groups}))


def test_the_slowest_scene_is_taken(tmp_path: Path) -> None:
    """20 frames in 0.2 s, alone and of 60 environments; failed scenes count nowhere."""
    write(tmp_path)
    speeds = read_speeds(tmp_path)
    assert speeds.slowest(1).frames_per_s == pytest.approx(100.0)
    assert speeds.slowest(60).frames_per_s == pytest.approx(6000.0)
    assert speeds.slowest(60).scene == "slow"
    assert speeds.count(60) == 2
    assert speeds.slowest_stress_s() == 1e-5
    assert speeds.cpu_frames_per_s is None


def test_a_folder_without_sixty_environments_is_refused(tmp_path: Path) -> None:
    """The message says what is missing and where it lies."""
    write(tmp_path, environments=(1,))
    with pytest.raises(RecordError, match="60 environments"):
        read_speeds(tmp_path)
