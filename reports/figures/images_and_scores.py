"""Real, simulated and difference images (the paper's trial figure), and the scores of them."""

import math
from collections.abc import Sequence
from string import ascii_lowercase
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import AsinhNorm
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Rectangle
from matplotlib.projections.polar import PolarAxes

from reports.comparison.result_types import TrialResult, ValidationReport
from reports.evidence.evidence_types import ImageGeometry, RunEvidence, TrialEvidence
from reports.figures import difference_colours as colours
from reports.figures.trial_axis import force_label, force_title, label_forces, shown
from reports.scores.image_metrics import ImageScores, Metric
from reports.scores.wrong_forces import CONTACT_RESIDUAL, WrongForceMatrix
from tacauchy_rig.core.plot_style import BLUE, GREEN, GREY, INK, ORANGE, PAGE_IN, letter, new_figure

SCALE_BAR_M = 5e-3
MARGINS_IN = 0.9


def draw_images(evidence: RunEvidence) -> Figure:
    """Draw three rows of images, one column a trial; differences share one scale."""
    trials = shown(evidence.trials)
    geometry = evidence.geometry
    panel = (PAGE_IN - MARGINS_IN) / max(len(trials), 3)
    height = 3 * (panel * geometry.height_px / geometry.width_px + 0.03) + 0.2
    figure = new_figure(PAGE_IN, height, marks=evidence.marks, pad_in=0.012)
    grid = figure.subplots(3, len(trials), squeeze=False)
    scale = colours.difference_scale(map(colours.luminance_difference, evidence.trials))
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
        ends = (colours.LINEAR_LEVELS, float(scale.vmax or colours.LEAST_LIMIT))
        ticks = [-ends[1], -ends[0], 0.0, *ends]
        bar.set_ticks(ticks, labels=[f"{tick:g}".replace("-", "\u2212") for tick in ticks])
        bar.minorticks_off()
        bar.ax.tick_params(labelsize=6)
        bar.outline.set_linewidth(0.4)
    return figure


def show_framed(axes: Axes, image: np.ndarray | None, **how: Any) -> AxesImage | None:
    """Show an image, or that there is none, with its border and without ticks."""
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set_visible(True)
    axes.spines[:].set_linewidth(0.3)
    if image is not None:
        return axes.imshow(image, **how)
    axes.text(0.5, 0.5, "none", color=GREY, ha="center", va="center", transform=axes.transAxes)
    return None


def _draw_column(column: np.ndarray, trial: TrialEvidence, norm: AsinhNorm) -> AxesImage | None:
    """Draw the images of a trial; return what is drawn of the difference."""
    real = None if trial.images is None else trial.images.real
    for axes, image in zip(column, (real, trial.simulated_image), strict=False):
        show_framed(axes, image, interpolation="none")
    scale = {"cmap": colours.DIFFERENCE_COLORS, "norm": norm, "interpolation": "none"}
    return show_framed(column[2], colours.luminance_difference(trial), **scale)


def _draw_scale_bar(axes: Axes, geometry: ImageGeometry) -> None:
    if geometry.scale_x_m_px is None or not axes.images:
        return
    length = SCALE_BAR_M / geometry.scale_x_m_px
    x, y = 0.06 * geometry.width_px, 0.90 * geometry.height_px
    axes.plot([x, x + length], [y, y], color="white", linewidth=1.6, solid_capstyle="butt")
    axes.text(x + length / 2, y - 8, "5 mm", color="white", ha="center", va="bottom", fontsize=5.5)


TITLES = {metric.value: metric.panel_title for metric in Metric} | {
    CONTACT_RESIDUAL: "Contact residual"
}
MAX_NUMBERED = 8


def draw_matrices(report: ValidationReport) -> Figure:
    """Draw every score of a press's own image (row) against simulated ones (column)."""
    rows = max(2, math.ceil(len(report.matrices) / 3))
    figure = new_figure(PAGE_IN, 2.3 * rows, marks=report.evidence.marks)
    panels = figure.subplots(rows, 3).ravel()
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


SIMILARITIES = {Metric.SSIM: BLUE, Metric.NCC: GREEN, Metric.HISTOGRAM_CORRELATION: ORANGE}
LINES: dict[str, dict[str, Any]] = {
    "Simulated": {"color": BLUE, "marker": "o", "markersize": 3},
    "No contact": {"color": INK, "marker": "_", "ls": "none", "markersize": 7},
    "Best wrong force": {"color": ORANGE, "marker": "x", "ls": "none", "markersize": 3.5},
    "Ceiling": {"color": GREY, "ls": "--", "lw": 0.7},
    "Position and light removed": {"color": GREEN, "marker": "s", "markersize": 2.5, "ls": ":"},
}
"""Of each panel, in the order of the legend."""


_CONTACT = {"zncc": "ZNCC in the contact", "relative_residual": "Residual in the contact"}


def draw_scores(report: ValidationReport) -> Figure:
    """Draw a radar chart of the similarities and a panel for every score."""
    trials = sorted(report.trials, key=lambda t: (math.isnan(t.force_target_n), t.force_target_n))
    rows = math.ceil((1 + len(Metric) + len(_CONTACT)) / 4)
    figure = new_figure(PAGE_IN, 1.85 * rows, marks=report.evidence.marks)
    grid = figure.add_gridspec(rows, 4)
    radar = figure.add_subplot(grid[0, 0], projection="polar")
    if isinstance(radar, PolarAxes):
        _draw_radar(radar, shown(trials))
    panels = []
    values = {metric.panel_title: _of_frame(trials, metric) for metric in Metric}
    values |= {label: _of_contact(trials, name) for name, label in _CONTACT.items()}
    without = [_number(t.contact_no_contact_residual) for t in trials]
    values[_CONTACT["relative_residual"]]["No contact"] = without
    for place, (label, lines_of) in enumerate(values.items(), start=1):
        panels.append(figure.add_subplot(grid[divmod(place, 4)]))
        _draw_panel(panels[-1], trials, label, lines_of)
        if label == Metric.MSE.panel_title:
            panels[-1].set_yscale("log")
    for axes, name in zip((radar, *panels), ascii_lowercase, strict=False):
        letter(axes, f"({name})")
    handles: dict[str, Artist] = {}
    for axes in panels:
        drawn, names = axes.get_legend_handles_labels()
        handles |= dict(zip(names, drawn, strict=True))
    ordered = [name for name in LINES if name in handles]
    lines = [handles[name] for name in ordered]
    figure.legend(lines, ordered, loc="outside lower center", ncols=len(ordered) or 1)
    return figure


def _of_frame(trials: Sequence[TrialResult], metric: Metric) -> dict[str, list[float]]:
    found: dict[str, list[ImageScores | None]] = {
        "Simulated": [t.metrics for t in trials],
        "No contact": [t.floors.no_contact if t.floors else None for t in trials],
        "Best wrong force": [t.floors.wrong_force if t.floors else None for t in trials],
        "Ceiling": [t.ceiling.scores if t.ceiling else None for t in trials],
    }
    return {name: [_finite(scores, metric) for scores in each] for name, each in found.items()}


def _of_contact(trials: Sequence[TrialResult], name: str) -> dict[str, list[float]]:
    fitted = [t.corrections and t.corrections.contact_pose_light_corrected for t in trials]
    return {
        "Simulated": [_number(getattr(t.contact, name, None)) for t in trials],
        "Position and light removed": [_number(getattr(each, name, None)) for each in fitted],
    }


def _draw_panel(
    axes: Axes, trials: Sequence[TrialResult], label: str, values: dict[str, list[float]]
) -> None:
    for name, line in values.items():
        if np.isfinite(line).any():
            axes.plot(line, label=name, **LINES[name])
    axes.set_title(label, fontsize=7.5)
    axes.grid(axis="y")
    axes.margins(x=0.08, y=0.12)
    label_forces(axes, trials)
    axes.set_xlabel("$F_z$ (N)", labelpad=1)


def _draw_radar(axes: PolarAxes, trials: Sequence[TrialResult]) -> None:
    angles = np.linspace(0.0, 2.0 * np.pi, len(trials), endpoint=False)
    closed = np.append(angles, angles[:1])
    lowest = 1.0
    for metric, color in SIMILARITIES.items():
        found = _of_frame(trials, metric)
        values, floors = found["Simulated"], found["No contact"]
        lowest = min([lowest, *(v for v in (*values, *floors) if math.isfinite(v))])
        axes.plot(closed, [*values, *values[:1]], color=color, label=metric.short)
        axes.plot(closed, [*floors, *floors[:1]], color=color, linestyle=":", linewidth=0.8)
    axes.set_theta_zero_location("N")
    axes.set_theta_direction(-1)
    axes.set_xticks(angles, [force_label(t) for t in trials], fontsize=6)
    axes.tick_params(axis="x", pad=-3)
    bottom = lowest - 0.3 * max(1.0 - lowest, 1e-3)
    axes.set_ylim(bottom, 1.0)
    axes.set_yticks([lowest, 1.0], [f"{lowest:.3f}", "1"], fontsize=5.5)
    axes.set_rlabel_position(180 / max(len(trials), 1))
    axes.spines["polar"].set_linewidth(0.4)
    axes.grid(visible=True)
    axes.legend(
        loc="upper center",
        bbox_to_anchor=(0.5, -0.08),
        ncols=3,
        fontsize=5.5,
        columnspacing=0.6,
        handlelength=0.8,
        handletextpad=0.3,
    )


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def _finite(scores: ImageScores | None, metric: Metric) -> float:
    value = math.nan if scores is None else scores.value(metric)
    return value if math.isfinite(value) else math.nan
