"""All figures of a report, in the order of the page, with their captions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from reports.comparison.results import ValidationReport
from reports.figures.forces import draw_force_depth, draw_time_curves
from reports.figures.images import LINEAR_LEVELS, draw_images, draw_matrices, draw_scores
from tacauchy_rig.core.figure_style import STYLE, save_figure
from tacauchy_rig.core.page import prose

THEIRS = ("images", "scores")
"""Drawn in the other process, if there is one: half of the time that all take."""


def draw_figures(
    report: ValidationReport, folder: Path, other: Executor | None = None
) -> list[dict[str, str]]:
    """Draw and write every figure that this run has data for, some in the other process.

    Returns:
        The figures' names, each of ``name.pdf`` and ``name.png`` in ``folder``, and captions.
    """
    folder.mkdir(parents=True, exist_ok=True)
    names = [name for name, _ in _figures(report)]
    theirs = [name for name in names if other and name in THEIRS]
    drawn = other.submit(draw_some, report, folder, theirs) if other and theirs else None
    draw_some(report, folder, [name for name in names if name not in theirs])
    if drawn is not None:
        drawn.result()
    return [{"name": name, "caption": _caption(name, report)} for name in names]


def draw_some(report: ValidationReport, folder: Path, names: Sequence[str]) -> None:
    """Draw and write the figures of these names."""
    with mpl.rc_context(STYLE):
        for name, draw in _figures(report):
            if name in names:
                save_figure(draw(report), folder, name)


def _caption(name: str, report: ValidationReport) -> str:
    return prose(
        "reports",
        "templates/captions.txt.jinja",
        name.replace("-", "_"),
        camera=report.evidence.camera,
        linear=f"{LINEAR_LEVELS:g}",
    )


def _figures(report: ValidationReport) -> Iterator[tuple[str, Callable[..., Figure]]]:
    recorded = report.evidence.trials
    if any(t.images is not None for t in recorded):
        yield "images", draw_images
    if any(t.metrics is not None for t in report.trials):
        yield "scores", draw_scores
    if report.matrices:
        yield "wrong-force", draw_matrices
    if any(t.force_curve is not None for t in recorded):
        yield "time", draw_time_curves
        yield "force-depth", draw_force_depth
