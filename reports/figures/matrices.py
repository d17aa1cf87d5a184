"""Wrong-force matrices: does a score know which force it looks at?"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from reports.comparison.results import ValidationReport
from reports.scores.floors import CONTACT_RESIDUAL, WrongForceMatrix
from reports.scores.metrics import Metric
from tacauchy_rig.core.figure_style import GREY, INK, ORANGE, PAGE_IN, new_figure

TITLES = {metric.value: metric.axis_label for metric in Metric} | {
    CONTACT_RESIDUAL: "Contact residual"
}
MAX_NUMBERED = 8


def draw_matrices(report: ValidationReport) -> Figure:
    """Draw every score of a press's own image (row) against simulated ones (column)."""
    figure = new_figure(PAGE_IN, 4.6, marks=report.evidence.marks)
    panels = figure.subplots(2, 3).ravel()
    for axes, matrix in zip(panels, report.matrices, strict=False):
        _draw_matrix(axes, matrix)
    for axes in panels[len(report.matrices) :]:
        axes.set_axis_off()
    figure.supxlabel("Simulated with the force of this press (N)", fontsize=8)
    figure.supylabel(f"{report.evidence.camera.capitalize()} press (N)", fontsize=8)
    return figure


def _draw_matrix(axes: Axes, matrix: WrongForceMatrix) -> None:
    values = np.array(matrix.values, dtype=np.float64)
    labels = [
        f"trial {trial}" if np.isnan(force) else f"{force:.2f}"
        for trial, force in zip(matrix.trials, matrix.forces_n, strict=True)
    ]
    count = len(labels)
    quality = values if matrix.larger_is_better else -values
    axes.imshow(_row_scaled(quality), cmap="cividis", vmin=0.0, vmax=1.0)
    axes.set_xticks(range(count), labels, rotation=45 if count > 4 else 0)
    axes.set_yticks(range(count), labels)
    axes.tick_params(length=0, labelsize=6 if count <= 2 * MAX_NUMBERED else 3)
    axes.spines[:].set_visible(False)
    won = sum(matrix.diagonal_wins)
    axes.set_title(f"{TITLES[matrix.metric]}: right force wins {won}/{count}", fontsize=7.5)
    best = np.nanargmax(np.where(np.isnan(quality), -np.inf, quality), axis=1)
    for i in range(count):
        is_right = best[i] == i or matrix.forces_n[best[i]] == matrix.forces_n[i]
        corner = (best[i] - 0.46, i - 0.46)
        edge = INK if is_right else ORANGE
        axes.add_patch(Rectangle(corner, 0.92, 0.92, fill=False, edgecolor=edge, lw=1.1))
    if count <= MAX_NUMBERED:
        shade = _row_scaled(quality)
        for (i, j), value in np.ndenumerate(values):
            _write_value(axes, i, j, float(value), float(shade[i, j]))


def _row_scaled(quality: np.ndarray) -> np.ndarray:
    """Return the quality from 0 to 1 in each row; NaN stays, all over a row of even images."""
    unknown = np.isnan(quality)
    low = np.where(unknown, np.inf, quality).min(axis=1, keepdims=True)
    span = np.where(unknown, -np.inf, quality).max(axis=1, keepdims=True) - low
    return np.asarray((quality - low) / np.where(span > 0, span, 1.0))


def _write_value(axes: Axes, i: int, j: int, value: float, shade: float) -> None:
    text = "–" if np.isnan(value) else _format(value)
    color = GREY if np.isnan(value) else INK if shade > 0.55 else "white"
    # Within its cell, so without a say in the layout, which would measure every one of them.
    written = axes.text(j, i, text, ha="center", va="center", fontsize=5.5, color=color)
    written.set_in_layout(False)


def _format(value: float) -> str:
    """Write four significant digits without the leading zero, so that close scores differ."""
    digits = 1 if abs(value) >= 100 else 2 if abs(value) >= 10 else 3 if abs(value) >= 1 else 4
    text = f"{value:.{digits}f}"
    return text.replace("0.", ".", 1) if abs(value) < 1 else text
