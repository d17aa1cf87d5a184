"""What is kept among the benchmarks: frames a second of a GPU, and scores of reported runs."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from sim.studies.bench.scenes import FRAME_COUNT
from tacauchy_rig.core.errors import RecordError

GPU_FILES = "h100_scenes.json"
CPU_FILE = "scenes.json"
# What the paper ran at once.
ENVIRONMENTS = 60
_PAPERS_PUNCH = "punch, the paper's"
REPORTS_FILE = "paper_reports.json"
SCORES = ("ssim", "ncc", "histogram_correlation", "psnr_db", "mse")


class SceneSpeed(NamedTuple):
    """One scene of the benchmark in one way."""

    scene: str
    environments: int
    frames_per_s: float  # of all together
    stress_s: float | None  # extraction of the surface's stress of all, where it was timed
    file: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Speeds:
    """What the kept benchmarks say."""

    gpu: tuple[SceneSpeed, ...]  # of an H100, every scene alone and in 60 environments
    cpu_frames_per_s: float | None  # the paper's punch on one thread, where it was timed
    cpu_machine: str  # what that ran on

    def of(self, environments: int) -> list[SceneSpeed]:
        """Return the scenes that were timed so."""
        return [each for each in self.gpu if each.environments == environments]

    def slowest(self, environments: int) -> SceneSpeed:
        """Return the scene with the fewest frames a second."""
        return min(self.of(environments), key=lambda each: each.frames_per_s)

    def slowest_stress_s(self) -> float:
        """Return the longest extraction of one environment's stress [s]."""
        return max(each.stress_s for each in self.of(1) if each.stress_s is not None)


def read_speeds(folder: Path) -> Speeds:
    """Read the benchmarks of a folder such as ``docs/results/benchmarks``.

    Raises:
        RecordError: There is none of a GPU with one and 60 environments.
    """
    files = sorted(folder.glob(GPU_FILES))
    gpu = tuple(_speed(row, file) for file in files for row in _rows(_read(file)))
    if not {1, ENVIRONMENTS} <= {each.environments for each in gpu}:
        raise RecordError(
            f"{folder}: no benchmark {GPU_FILES} with 1 and {ENVIRONMENTS} environments",
            remedy="give --benchmarks the folder docs/results/benchmarks of the repository",
        )
    kept = _read(folder / CPU_FILE) if (folder / CPU_FILE).exists() else {"machine": ""}
    punch = [row["press"] for row in _rows(kept) if row["scene"] == _PAPERS_PUNCH]
    return Speeds(
        gpu=gpu,
        cpu_frames_per_s=FRAME_COUNT / punch[0]["cpu_s"] if punch else None,
        cpu_machine=kept["machine"] if punch else "",
    )


def _read(file: Path) -> Any:
    return json.loads(file.read_text("utf-8"))


def _speed(row: Mapping[str, Any], file: Path) -> SceneSpeed:
    """Return a scene of a file."""
    press, count = row["press"], row["environments"] or 1
    stress_s = press.get("parts_s", {}).get("stress")
    return SceneSpeed(
        row["scene"], count, FRAME_COUNT * count / press["wall_s"], stress_s, file.name
    )


def _rows(benchmark: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the scenes of a benchmark that were pressed."""
    groups = benchmark.get("groups", [])
    return [row for group in groups for row in group if row["press"] is not None]


Report = dict[str, Any]
"""What a report's summary says of a run's images.

``name``: The sensor, or what a run was imported from. ``emulated``: Its images are of emulated
devices: nothing about a real sensor follows. ``imported``: Recorded elsewhere. ``made``: When the
run was made, and with which version. ``press_count``: Presses with images. ``no_contact``,
``ours``: Mean scores of the no-contact frame and of the simulated images, by score; empty where
none were simulated. ``trials``: Of each simulated image its force ``force_n``, and its scores.
"""


def of_run(run: Path) -> Report:
    """Read the report of a run folder.

    Raises:
        RecordError: There is none, or it has no images.
    """
    file = run / "report" / "summary.json"
    try:
        summary = _read(file)
    except OSError as error:
        raise RecordError(
            f"{file}: cannot be read: {error.strerror}",
            remedy="write it with `tacauchy-rig report`",
        ) from error
    statistics, provenance = summary["statistics"], summary["provenance"]
    floor = _means(statistics["no_contact"])
    if not floor:
        raise RecordError(f"{file} has no scores of images", remedy="report on a run with images")
    # The sensor, where the report names it, else what the run was imported from.
    sensor = (summary["optics"] or {}).get("sensor") or summary["model"].get("sensor")
    version = provenance["versions"]["tacauchy-rig"]
    return {
        "name": str(sensor or provenance["imported"].get("source") or "a sensor"),
        "emulated": summary["simulated"],
        "imported": summary["imported"],
        "made": f"{provenance['created'][:10]}, version {version}",
        "press_count": statistics["no_contact"]["ssim"]["count"],
        "no_contact": floor,
        "ours": _means(statistics["metrics"]),
        "trials": [
            {"force_n": trial["force_measured_n"], **trial["metrics"]}
            for trial in summary["trials"]
            if trial["force_measured_n"] is not None
            and all(trial["metrics"][score] is not None for score in SCORES)
        ],
    }


def _means(statistics: Mapping[str, Any]) -> dict[str, float]:
    means = {score: statistics[score]["mean"] for score in SCORES}
    return {score: mean for score, mean in means.items() if mean is not None}


def read_kept(folder: Path) -> list[Report]:
    """Read what is kept in a folder; empty where nothing is."""
    file = folder / REPORTS_FILE
    return _read(file) if file.exists() else []
