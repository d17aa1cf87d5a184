"""All figures of a report, in the order of the page, with their captions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from reports.comparison.results import ValidationReport
from reports.figures.diagnostics import draw_arrival, draw_contact, draw_truth
from reports.figures.forces import (
    budgeted,
    draw_budget,
    draw_force_depth,
    draw_pressure,
    draw_time_curves,
)
from reports.figures.images import LINEAR_LEVELS, draw_images, draw_matrices
from reports.figures.scores import draw_errors, draw_residual, draw_similarities, residual_of
from tacauchy_rig.core.figure_style import STYLE, save_figure
from tacauchy_rig.core.page import prose


def draw_figures(report: ValidationReport, folder: Path) -> list[dict[str, str]]:
    """Draw and write every figure that this run has data for.

    Returns:
        The figures' names, each of ``name.pdf`` and ``name.png`` in ``folder``, and captions.
    """
    folder.mkdir(parents=True, exist_ok=True)
    drawn = []
    with mpl.rc_context(STYLE):
        for name, draw in _figures(report):
            save_figure(draw(report), folder, name)
            block = name.replace("-", "_")
            camera = report.evidence.camera
            caption = prose(
                "reports",
                "templates/captions.txt.jinja",
                block,
                camera=camera,
                linear=f"{LINEAR_LEVELS:g}",
            )
            drawn.append({"name": name, "caption": caption})
    return drawn


def _figures(report: ValidationReport) -> Iterator[tuple[str, Callable[..., Figure]]]:
    recorded = report.evidence.trials
    if any(t.images is not None for t in recorded):
        yield "images", draw_images
    if any(t.metrics is not None for t in report.trials):
        yield "similarities", draw_similarities
        yield "errors", draw_errors
    if report.matrices:
        yield "wrong-force", draw_matrices
    if any(t.contact is not None for t in report.trials):
        yield "contact", draw_contact
    if residual_of(report) is not None:
        yield "residual", draw_residual
    if any(t.force_curve is not None for t in recorded):
        yield "time", draw_time_curves
        yield "force-depth", draw_force_depth
    if any(t.pressure is not None for t in recorded):
        yield "pressure", draw_pressure
    if budgeted(report):
        yield "budget", draw_budget
    if any(t.streams for t in recorded):
        yield "arrival", draw_arrival
    if any(c.unit == "mm" or c.true != 0.0 for c in report.truth):
        yield "truth", draw_truth
