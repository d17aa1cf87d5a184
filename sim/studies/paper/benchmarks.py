"""Frames a second of a machine that not everybody has, from the benchmarks that are kept."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim.studies.bench.scenes.press import FRAME_COUNT
from tacauchy_rig.core.errors import RecordError

GPU_FILES = "h200_*.json"
CPU_FILE = "scenes.json"
# What the paper ran at once.
ENVIRONMENTS = 60
_PAPERS_PUNCH = "punch, the paper's"


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneSpeed:
    """One scene of the benchmark in one way.

    Attributes:
        environments: How many at once.
        frames_per_s: Of all together.
        stress_s: Extraction of the surface's stress of all; None where it was not timed.
        file: The benchmark's.
    """

    scene: str
    environments: int
    frames_per_s: float
    stress_s: float | None
    file: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Speeds:
    """What the kept benchmarks say.

    Attributes:
        gpu: Of an H200, every scene alone and in 60 environments.
        cpu_frames_per_s: The paper's punch on one thread; None where it was not timed.
        cpu_machine: What that ran on.
    """

    gpu: tuple[SceneSpeed, ...]
    cpu_frames_per_s: float | None
    cpu_machine: str

    def slowest(self, environments: int) -> SceneSpeed:
        """Return the scene with the fewest frames a second."""
        return min(self._of(environments), key=lambda each: each.frames_per_s)

    def count(self, environments: int) -> int:
        """Return how many scenes were timed so."""
        return len(self._of(environments))

    def slowest_stress_s(self) -> float:
        """Return the longest extraction of one environment's stress [s]."""
        return max(each.stress_s for each in self._of(1) if each.stress_s is not None)

    def _of(self, environments: int) -> list[SceneSpeed]:
        return [each for each in self.gpu if each.environments == environments]


def read_speeds(folder: Path) -> Speeds:
    """Read the benchmarks of a folder such as ``docs/results/benchmarks``.

    Raises:
        RecordError: There is none of a GPU with one and 60 environments.
    """
    files = sorted(folder.glob(GPU_FILES))
    gpu = tuple(speed for file in files for speed in _speeds(file))
    if not {1, ENVIRONMENTS} <= {each.environments for each in gpu}:
        raise RecordError(
            f"{folder}: no benchmark {GPU_FILES} with 1 and {ENVIRONMENTS} environments",
            remedy="give --benchmarks the folder docs/results/benchmarks of the repository",
        )
    file = folder / CPU_FILE
    kept: dict[str, Any] = {"groups": [], "machine": ""}
    if file.exists():
        kept = json.loads(file.read_text("utf-8"))
    spent = [
        row["press"]["cpu_s"]
        for group in kept["groups"]
        for row in group
        if row["scene"] == _PAPERS_PUNCH and row["press"] is not None
    ]
    return Speeds(
        gpu=gpu,
        cpu_frames_per_s=FRAME_COUNT / spent[0] if spent else None,
        cpu_machine=kept["machine"],
    )


def _speeds(file: Path) -> list[SceneSpeed]:
    rows = [row for group in json.loads(file.read_text("utf-8")).get("groups", []) for row in group]
    return [_speed(row, file.name) for row in rows if row["press"] is not None]


def _speed(row: dict[str, Any], file: str) -> SceneSpeed:
    press, count = row["press"], row["environments"] or 1
    return SceneSpeed(
        scene=row["scene"],
        environments=count,
        frames_per_s=FRAME_COUNT * count / press["wall_s"],
        stress_s=press.get("parts_s", {}).get("stress"),
        file=file,
    )
