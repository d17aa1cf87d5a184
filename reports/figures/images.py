"""Real, simulated and difference images over the target forces (the paper's trial figure)."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import AsinhNorm
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Rectangle

from reports.comparison.results import ValidationReport
from reports.evidence.evidence import ImageGeometry, TrialEvidence, TrialImages
from reports.figures.trials import force_title, shown
from reports.scores.floors import CONTACT_RESIDUAL, WrongForceMatrix
from reports.scores.metrics import Metric
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.figure_style import GREY, INK, ORANGE, PAGE_IN, new_figure
from tacauchy_rig.core.rgb import to_grey

SCALE_BAR_M = 5e-3
MARGINS_IN = 0.9
LEAST_LIMIT = 5.0  # [grey level]: differences below it are faint even at the end of the scale
LINEAR_LEVELS = 2.0
"""To which the scale of differences is linear, so that what is faint shows beside the largest."""
DIFFERENCE_COLORS = "PuOr_r"


def draw_images(report: ValidationReport) -> Figure:
    """Draw three rows of images, one column a trial; differences share one scale."""
    evidence = report.evidence
    trials = shown(evidence.trials)
    geometry = evidence.geometry
    panel = (PAGE_IN - MARGINS_IN) / max(len(trials), 3)
    height = 3 * (panel * geometry.height_px / geometry.width_px + 0.03) + 0.2
    figure = new_figure(PAGE_IN, height, marks=evidence.marks, pad_in=0.012)
    grid = figure.subplots(3, len(trials), squeeze=False)
    scale = difference_scale(map(luminance_difference, evidence.trials))
    mapped: AxesImage | None = None
    for column, trial in enumerate(trials):
        mapped = _draw_column(grid[:, column], trial, scale) or mapped
        title = force_title(trial, "$F_z$ = {} N")
        grid[0, column].set_title(title, fontsize=7.5, pad=3)
    rows = (evidence.camera.capitalize(), "Simulated", "Difference")
    for row, name in enumerate(rows):
        grid[row, 0].set_ylabel(name)
    _draw_scale_bar(grid[0, 0], geometry)
    if mapped is not None:
        bar = figure.colorbar(mapped, cax=grid[2, -1].inset_axes((1.06, 0.0, 0.06, 1.0)))
        bar.set_label(f"Sim. − {evidence.camera}\n(grey levels)", fontsize=6.5, linespacing=1.0)
        ends = (LINEAR_LEVELS, float(scale.vmax or LEAST_LIMIT))
        ticks = [-ends[1], -ends[0], 0.0, *ends]
        bar.set_ticks(ticks, labels=[f"{tick:g}".replace("-", "\u2212") for tick in ticks])
        bar.minorticks_off()
        bar.ax.tick_params(labelsize=6)
        bar.outline.set_linewidth(0.4)
    return figure


def luminance_difference(trial: TrialEvidence) -> FloatArray | None:
    """Return simulated minus real luminance, shape [height, width] [grey level]."""
    if trial.images is None or trial.simulated_image is None:
        return None
    return luminance_error(trial.images, trial.simulated_image)


def luminance_error(images: TrialImages, simulated: ImageArray) -> FloatArray:
    """Return simulated minus camera luminance, shape [height, width] [grey level]."""
    return to_grey(simulated).astype(np.float64) - to_grey(images.real).astype(np.float64)


def frame_panel(axes: Axes) -> None:
    """Show an image's border without ticks."""
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set_visible(True)
    axes.spines[:].set_linewidth(0.3)


def difference_scale(differences: Iterable[FloatArray | None]) -> AsinhNorm:
    """Return the symmetric scale of colours for all of them [grey level]; nothing clips."""
    largest = [float(np.ceil(np.abs(d).max())) for d in differences if d is not None]
    limit = max([LEAST_LIMIT, *largest])
    return AsinhNorm(linear_width=LINEAR_LEVELS, vmin=-limit, vmax=limit)


def _draw_column(column: np.ndarray, trial: TrialEvidence, norm: AsinhNorm) -> AxesImage | None:
    """Draw the images of a trial; return what is drawn of the difference."""
    real = None if trial.images is None else trial.images.real
    scale = {"cmap": DIFFERENCE_COLORS, "norm": norm}
    mapped: AxesImage | None = None
    for axes, image in zip(
        column, (real, trial.simulated_image, luminance_difference(trial)), strict=True
    ):
        frame_panel(axes)
        mapped = None
        if image is None:
            where = {"ha": "center", "va": "center", "transform": axes.transAxes}
            axes.text(0.5, 0.5, "none", color=GREY, **where)
        else:
            mapped = axes.imshow(
                image, interpolation="nearest", **(scale if image.ndim == 2 else {})
            )
    return mapped


def _draw_scale_bar(axes: Axes, geometry: ImageGeometry) -> None:
    if geometry.scale_x_m_px is None or not axes.images:
        return
    length = SCALE_BAR_M / geometry.scale_x_m_px
    x, y = 0.06 * geometry.width_px, 0.90 * geometry.height_px
    axes.plot([x, x + length], [y, y], color="white", linewidth=1.6, solid_capstyle="butt")
    axes.text(x + length / 2, y - 8, "5 mm", color="white", ha="center", va="bottom", fontsize=5.5)


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
    order = np.argsort(matrix.forces_n, kind="stable")  # those without a force come last
    values = np.array(matrix.values, dtype=np.float64)[np.ix_(order, order)]
    forces_n = np.array(matrix.forces_n)[order]
    labels = [
        f"trial {trial}" if np.isnan(force) else f"{force:.2f}"
        for trial, force in zip(np.array(matrix.trials)[order], forces_n, strict=True)
    ]
    count = len(labels)
    quality = values if matrix.larger_is_better else -values
    axes.imshow(_row_scaled(quality), cmap="cividis", vmin=0.0, vmax=1.0)
    axes.set_xticks(range(count), labels, rotation=45 if count > 4 else 0)
    axes.set_yticks(range(count), labels)
    axes.tick_params(length=0, labelsize=6 if count <= 2 * MAX_NUMBERED else 3)
    axes.spines[:].set_visible(False)
    won = sum(matrix.diagonal_wins)
    axes.set_title(f"{TITLES[matrix.metric]}: correct force wins {won}/{count}", fontsize=7.5)
    best = np.nanargmax(np.where(np.isnan(quality), -np.inf, quality), axis=1)
    for i in range(count):
        is_right = best[i] == i or forces_n[best[i]] == forces_n[i]
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
