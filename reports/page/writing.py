"""Write a report: figures, images, ``summary.json``, and what is made from it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from reports.comparison.results import ValidationReport
from reports.figures.draw import draw_figures
from reports.page.html import render_html
from reports.page.pictures import write_pictures
from reports.page.summary import build_summary
from reports.page.tables import junit_xml, metrics_csv
from tacauchy_rig.errors import RecordError
from tacauchy_rig.store.codec import to_plain


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportPaths:
    """Where the parts of a report lie."""

    html: Path
    summary: Path
    junit: Path
    metrics: Path
    figures: Path
    images: Path


def write_report(report: ValidationReport, folder: Path) -> ReportPaths:
    """Write all files of a report into ``folder``; an older report there is overwritten.

    Raises:
        RecordError: The folder cannot be written.
    """
    paths = ReportPaths(
        html=folder / "report.html",
        summary=folder / "summary.json",
        junit=folder / "junit.xml",
        metrics=folder / "metrics.csv",
        figures=folder / "figures",
        images=folder / "images",
    )
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
    pictures = write_pictures(report.evidence, paths.images)
    summary = build_summary(report)
    summary["figures"] = to_plain(figures)
    for trial in summary["trials"]:
        trial["images"] = pictures.get(trial["index"], {})
    # allow_nan=False: a NaN that slipped through is a bug of ours and must not reach a reader.
    text = json.dumps(summary, indent=2, ensure_ascii=False, allow_nan=False)
    paths.summary.write_text(text + "\n", encoding="utf-8")
    paths.metrics.write_text(metrics_csv(summary), encoding="utf-8")
    paths.junit.write_text(junit_xml(summary), encoding="utf-8")
    paths.html.write_text(
        render_html(summary, figures=paths.figures, images=paths.images), encoding="utf-8"
    )
