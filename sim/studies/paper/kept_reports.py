"""Scores of runs that were reported on, kept beside the benchmarks: real presses and emulated."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from tacauchy_rig.core.errors import RecordError

FILE = "paper_reports.json"
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
        name=_name(summary),
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


def _name(summary: Mapping[str, Any]) -> str:
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
    file = folder / FILE
    if not file.exists():
        return []
    return TypeAdapter(list[KeptReport]).validate_json(file.read_text("utf-8"))


def kept_text(reports: list[KeptReport]) -> str:
    """Return reports as JSON."""
    return json.dumps([asdict(report) for report in reports], indent=1) + "\n"
