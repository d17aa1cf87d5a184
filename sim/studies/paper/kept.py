"""What is kept among the benchmarks: frames a second of a GPU, and scores of reported runs."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from sim.studies.bench.scenes import FRAME_COUNT
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
    gpu = tuple(_speed(row, file.name) for file in files for row in _rows(file))
    if not {1, ENVIRONMENTS} <= {each.environments for each in gpu}:
        raise RecordError(
            f"{folder}: no benchmark {GPU_FILES} with 1 and {ENVIRONMENTS} environments",
            remedy="give --benchmarks the folder docs/results/benchmarks of the repository",
        )
    file, punch = folder / CPU_FILE, list[float]()
    if file.exists():
        rows = [row for row in _rows(file) if row["scene"] == _PAPERS_PUNCH]
        punch = [FRAME_COUNT / row["press"]["cpu_s"] for row in rows]
    return Speeds(
        gpu=gpu,
        cpu_frames_per_s=punch[0] if punch else None,
        cpu_machine=json.loads(file.read_text("utf-8"))["machine"] if punch else "",
    )


def _rows(file: Path) -> list[dict[str, Any]]:
    """Return the scenes of a benchmark that were pressed."""
    groups = json.loads(file.read_text("utf-8")).get("groups", [])
    return [row for group in groups for row in group if row["press"] is not None]


def _speed(row: dict[str, Any], file: str) -> SceneSpeed:
    press, count = row["press"], row["environments"] or 1
    return SceneSpeed(
        scene=row["scene"],
        environments=count,
        frames_per_s=FRAME_COUNT * count / press["wall_s"],
        stress_s=press.get("parts_s", {}).get("stress"),
        file=file,
    )


REPORTS_FILE = "paper_reports.json"
SCORES = ("ssim", "ncc", "histogram_correlation", "psnr_db", "mse")


@dataclass(frozen=True, slots=True, kw_only=True)
class KeptReport:
    """What a report's summary says of a run's images.

    Attributes:
        name: The sensor, or what a run was imported from.
        emulated: Its images are of emulated devices: nothing about a real sensor follows.
        imported: Recorded elsewhere.
        made: When the run was made, and with which version.
        press_count: Presses with images.
        no_contact: Mean scores of the no-contact frame against the presses, by score.
        ours: Mean scores of the simulated images, by score; empty where none were simulated.
        trials: Of each simulated image its force [N] as ``force_n``, and its scores.
    """

    name: str
    emulated: bool
    imported: bool
    made: str
    press_count: int
    no_contact: dict[str, float]
    ours: dict[str, float]
    trials: tuple[dict[str, float], ...] = ()


def of_run(run: Path) -> KeptReport:
    """Read the report of a run folder.

    Raises:
        RecordError: There is none, or it has no images.
    """
    file = run / "report" / "summary.json"
    try:
        summary = json.loads(file.read_text("utf-8"))
    except OSError as error:
        raise RecordError(
            f"{file}: cannot be read: {error.strerror}",
            remedy="write it with `tacauchy-rig report`",
        ) from error
    statistics, provenance = summary["statistics"], summary["provenance"]
    floor = _means(statistics["no_contact"])
    if not floor:
        raise RecordError(f"{file} has no scores of images", remedy="report on a run with images")
    version = provenance["versions"]["tacauchy-rig"]
    return KeptReport(
        name=_sensor_name(summary),
        emulated=summary["simulated"],
        imported=summary["imported"],
        made=f"{provenance['created'][:10]}, version {version}",
        press_count=statistics["no_contact"]["ssim"]["count"],
        no_contact=floor,
        ours=_means(statistics["metrics"]),
        trials=tuple(
            {"force_n": trial["force_measured_n"], **trial["metrics"]}
            for trial in summary["trials"]
            if trial["force_measured_n"] is not None
            and all(trial["metrics"][score] is not None for score in SCORES)
        ),
    )


def _sensor_name(summary: Mapping[str, Any]) -> str:
    """Return the sensor, where the report names it, else what the run was imported from."""
    sensor = (summary["optics"] or {}).get("sensor") or summary["model"].get("sensor")
    return str(sensor or summary["provenance"]["imported"].get("source") or "a sensor")


def _means(statistics: Mapping[str, Any]) -> dict[str, float]:
    return {
        score: statistics[score]["mean"]
        for score in SCORES
        if statistics[score]["mean"] is not None
    }


def read_kept(folder: Path) -> list[KeptReport]:
    """Read what is kept in a folder; empty where nothing is."""
    file = folder / REPORTS_FILE
    if not file.exists():
        return []
    return TypeAdapter(list[KeptReport]).validate_json(file.read_text("utf-8"))


def json_lines(records: Sequence[Any]) -> str:
    """Return records as JSON that a repository can keep."""
    return json.dumps([asdict(record) for record in records], indent=1) + "\n"
