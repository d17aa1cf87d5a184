"""Real, simulated and difference images over the target forces (the paper's trial figure)."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import AsinhNorm
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from reports.comparison.results import ValidationReport
from reports.evidence.evidence import ImageGeometry, TrialEvidence
from reports.figures.trials import force_title, shown
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.figure_style import GREY, PAGE_IN, new_figure
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
    real = to_grey(trial.images.real).astype(np.float64)
    return to_grey(trial.simulated_image).astype(np.float64) - real


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
        axes.set(xticks=[], yticks=[])
        axes.spines[:].set_visible(True)
        axes.spines[:].set_linewidth(0.3)
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
