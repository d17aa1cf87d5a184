"""All figures of a report, in the order of the page, with their captions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from reports.comparison.results import ValidationReport
from reports.evidence.evidence import RunEvidence
from reports.figures.forces import draw_force_depth, draw_time_curves
from reports.figures.images import LINEAR_LEVELS, draw_images, draw_matrices, draw_scores
from tacauchy_rig.core.figure_style import STYLE, save_figure
from tacauchy_rig.core.page import prose


def _has_curves(evidence: RunEvidence) -> bool:
    return any(trial.force_curve is not None for trial in evidence.trials)


FIGURES: dict[str, tuple[Callable[[Any], Figure], Callable[[Any], bool]]] = {
    "images": (draw_images, lambda evidence: any(t.images is not None for t in evidence.trials)),
    "scores": (draw_scores, lambda report: any(t.metrics is not None for t in report.trials)),
    "wrong-force": (draw_matrices, lambda report: bool(report.matrices)),
    "time": (draw_time_curves, _has_curves),
    "force-depth": (draw_force_depth, lambda report: _has_curves(report.evidence)),
}
"""How each figure of the page is drawn, in order, and whether a run has data for it."""
RECORDED = ("images", "time")
"""Drawn of the evidence; the others of the report."""
THEIRS = ("scores",)
"""Of the report, drawn in the other process, which by then has drawn those of the evidence."""
OURS = ("wrong-force", "force-depth")


def draw_figures(
    report: ValidationReport,
    folder: Path,
    other: Executor | None = None,
    recorded: Future[list[str]] | None = None,
) -> list[dict[str, str]]:
    """Draw and write every figure that this run has data for.

    Args:
        report: Whose figures.
        folder: Where each becomes ``name.pdf`` and ``name.png``.
        other: Another process, which draws some of them.
        recorded: What another process drew, or still draws, of the evidence.

    Returns:
        The figures' names and captions.
    """
    drawn = replace(report, evidence=report.evidence.drawn)
    theirs = other.submit(draw_some, drawn, folder, THEIRS) if other else None
    names = draw_some(report, folder, OURS)
    names += theirs.result() if theirs else draw_some(report, folder, THEIRS)
    names += recorded.result() if recorded else draw_some(report.evidence, folder, RECORDED)
    return [{"name": name, "caption": _caption(name, report)} for name in FIGURES if name in names]


def draw_some(
    shown: RunEvidence | ValidationReport, folder: Path, names: Sequence[str]
) -> list[str]:
    """Draw and write those of some figures that there is data for; return their names."""
    drawn = [name for name in names if FIGURES[name][1](shown)]
    folder.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(STYLE):
        for name in drawn:
            save_figure(FIGURES[name][0](shown), folder, name)
    return drawn


def _caption(name: str, report: ValidationReport) -> str:
    return prose(
        "reports",
        "templates/captions.txt.jinja",
        name.replace("-", "_"),
        camera=report.evidence.camera,
        linear=f"{LINEAR_LEVELS:g}",
    )
