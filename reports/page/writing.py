"""Write a report: figures, images, ``summary.json``, and what is made from it."""

from __future__ import annotations

import json
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.colors import AsinhNorm

from reports.comparison.results import ValidationReport
from reports.evidence.evidence import RunEvidence
from reports.figures.draw import draw_figures
from reports.figures.images import DIFFERENCE_COLORS, difference_scale, luminance_difference
from reports.page.html import render_html
from reports.page.passing import passing_numbers, passing_pictures
from reports.page.summary import build_summary, junit_xml, metrics_csv
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.rgb import encode_png

OPTICS_PICTURE = "optics-held-out.png"


class ReportPaths:
    """Where the parts of a report lie."""

    def __init__(self, folder: Path) -> None:
        self.html = folder / "report.html"
        self.summary = folder / "summary.json"
        self.junit = folder / "junit.xml"
        self.metrics = folder / "metrics.csv"
        self.figures = folder / "figures"
        self.images = folder / "images"


def write_report(report: ValidationReport, folder: Path) -> ReportPaths:
    """Write all files of a report into ``folder``; an older report there is overwritten.

    Raises:
        RecordError: The folder cannot be written.
    """
    paths = ReportPaths(folder)
    try:
        _write(report, paths)
    except OSError as error:
        raise RecordError(
            f"report in {folder}: cannot be written: {error.strerror or error}",
            remedy="check space and permissions, then `tacauchy-rig report RUN` writes it again",
        ) from error
    return paths


def _write(report: ValidationReport, paths: ReportPaths) -> None:
    figures = draw_figures(report, paths.figures)
    pictures = _write_pictures(report.evidence, paths.images)
    if picture := report.evidence.optics_picture:
        (paths.images / OPTICS_PICTURE).write_bytes(picture)
    summary = build_summary(report)
    summary["figures"] = figures
    passing = passing_numbers(report.evidence)
    for trial in summary["trials"]:
        trial["images"] = pictures.get(trial["index"], {})
        trial["passing"] = passing.get(trial["index"], [])
    # allow_nan=False: a NaN that slipped through is a bug of ours and must not reach a reader.
    summary["optics_picture"] = OPTICS_PICTURE if picture else None
    text = json.dumps(summary, indent=2, ensure_ascii=False, allow_nan=False)
    paths.summary.write_text(text + "\n", encoding="utf-8")
    paths.metrics.write_text(metrics_csv(summary), encoding="utf-8")
    paths.junit.write_text(junit_xml(summary), encoding="utf-8")
    paths.html.write_text(
        render_html(
            summary,
            figures=paths.figures,
            images=paths.images,
            passing=passing_pictures(report.evidence),
        ),
        encoding="utf-8",
    )


def _write_pictures(evidence: RunEvidence, folder: Path) -> dict[int, dict[str, str]]:
    """Write the images of every trial.

    Returns:
        Per trial, file names by kind: ``real``, ``reference``, ``simulated``, ``difference``.

    Raises:
        RecordError: A file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    scale = difference_scale(map(luminance_difference, evidence.trials))
    names: dict[int, dict[str, str]] = {}
    for trial in evidence.trials:
        difference = luminance_difference(trial)
        images = {
            "real": None if trial.images is None else trial.images.real,
            "reference": None if trial.images is None else trial.images.reference,
            "simulated": trial.simulated_image,
            "difference": None if difference is None else color_difference(difference, scale),
        }
        for kind, image in images.items():
            if image is not None:
                name = f"{trial.index:02d}-{kind}.png"
                (folder / name).write_bytes(encode_png(image))
                names.setdefault(trial.index, {})[kind] = name
    return names


def color_difference(difference: FloatArray, scale: AsinhNorm) -> ImageArray:
    """Map differences [grey level] to a diverging colour map, white at zero."""
    colors = mpl.colormaps[DIFFERENCE_COLORS](scale(difference))
    return np.rint(255.0 * np.asarray(colors)[..., :3]).astype(np.uint8)
