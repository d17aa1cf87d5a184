"""The five scores, and the causes of the residual, over the target forces."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.projections.polar import PolarAxes

from reports.comparison.results import TrialResult, ValidationReport
from reports.figures.trials import force_label, label_forces, legend_above, shown
from reports.scores.metrics import ImageScores, Metric
from reports.scores.residual_split import Cause
from tacauchy_rig.core.figure_style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    LIGHT,
    ORANGE,
    PAGE_IN,
    PURPLE,
    SKY,
    letter,
    new_figure,
)
from tacauchy_rig.core.simulated import ResidualSplit

MINUS = "\u2212"
COLORS = {
    Cause.POSE: BLUE,
    Cause.TILT: SKY,
    Cause.LIGHT: "#E69F00",  # the orange of Okabe and Ito that no line has
    Cause.FORCE: ORANGE,
    Cause.MATERIAL: PURPLE,
    Cause.OPTICS: GREEN,
    Cause.NOISE: GREY,
    Cause.REST: LIGHT,
}


def residual_of(report: ValidationReport) -> ResidualSplit | None:
    """Return what a run's replay says of its residual."""
    return None if report.evidence.model is None else report.evidence.model.residual


def draw_residual(report: ValidationReport) -> Figure:
    """Draw the residual of each press by its causes, and their shares of all presses."""
    split = residual_of(report)
    figure = new_figure(PAGE_IN, 2.1, marks=report.evidence.marks)
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    if split is None:
        return figure
    _draw_presses(left, split, report.trials)
    _draw_ranking(right, split)
    letter(left, "(a)")
    letter(right, "(b)")
    return figure


def _draw_presses(axes: Axes, split: ResidualSplit, results: Sequence[TrialResult]) -> None:
    by_index = {trial.trial: trial for trial in split.trials}
    pressed = [result for result in results if result.index in by_index]
    for column, result in enumerate(pressed):
        trial = by_index[result.index]
        above = below = 0.0
        for cause in split.shares:
            size = 100.0 * trial.residual * trial.shares[cause]
            start = above if size >= 0.0 else below
            axes.bar(
                column, size, 0.7, bottom=start, color=COLORS[Cause(cause)], edgecolor=INK, lw=0.2
            )
            above, below = (above + size, below) if size >= 0.0 else (above, below + size)
    axes.axhline(0.0, color=INK, linewidth=0.5)
    label_forces(axes, pressed)
    axes.set_ylabel("Residual (% of the change)")
    axes.grid(axis="y")


def _draw_ranking(axes: Axes, split: ResidualSplit) -> None:
    names = list(split.shares)
    values = [100.0 * share for share in split.shares.values()]
    colors = [COLORS[Cause(name)] for name in names]
    axes.barh(range(len(names)), values, 0.7, color=colors, edgecolor=INK, lw=0.2)
    for row, value in enumerate(values):
        text = f"{value:.0f} %".replace("-", MINUS)
        axes.text(max(value, 0.0) + 1.0, row, text, va="center", fontsize=7)
    axes.axvline(0.0, color=INK, linewidth=0.5)
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set_xlim(right=1.15 * max(values))
    axes.set_xlabel("Of the residual's square (%)")


SIMILARITIES = {Metric.SSIM: BLUE, Metric.NCC: GREEN, Metric.HISTOGRAM_CORRELATION: ORANGE}
FLOOR_STYLE: dict[str, Any] = {"color": INK, "marker": "_", "markersize": 6, "linestyle": "none"}


def draw_similarities(report: ValidationReport) -> Figure:
    """Draw a radar chart and bars of SSIM, NCC and histogram correlation."""
    figure = new_figure(PAGE_IN, 2.35, marks=report.evidence.marks)
    grid = figure.add_gridspec(1, 2, width_ratios=(0.36, 0.64))
    radar = figure.add_subplot(grid[0], projection="polar")
    if isinstance(radar, PolarAxes):
        _draw_radar(radar, shown(report.trials))
    _draw_bars(figure.add_subplot(grid[1]), report.trials)
    return figure


def _draw_radar(axes: PolarAxes, trials: Sequence[TrialResult]) -> None:
    angles = np.linspace(0.0, 2.0 * np.pi, len(trials), endpoint=False)
    closed = np.append(angles, angles[:1])
    lowest = 1.0
    for metric, color in SIMILARITIES.items():
        values = [_value(t, metric) for t in trials]
        floors = [_floor(t, metric) for t in trials]
        lowest = min([lowest, *(v for v in (*values, *floors) if math.isfinite(v))])
        axes.plot(closed, [*values, *values[:1]], color=color, marker="o", markersize=2)
        axes.plot(closed, [*floors, *floors[:1]], color=color, linestyle=":", linewidth=0.8)
    axes.set_theta_zero_location("N")
    axes.set_theta_direction(-1)
    axes.set_xticks(angles, [f"{force_label(t)} N" for t in trials])
    axes.tick_params(axis="x", pad=0)
    bottom = max(-1.0, math.floor(lowest * 5.0 - 0.25) / 5.0)
    axes.set_ylim(bottom, 1.0)
    rings = np.linspace(bottom, 1.0, 3)[1:]
    axes.set_yticks(rings, [f"{ring:.2g}" for ring in rings], fontsize=6)
    axes.set_rlabel_position(180 / max(len(trials), 1))
    axes.spines["polar"].set_linewidth(0.4)
    axes.grid(visible=True)
    letter(axes, "(a)")


def _draw_bars(axes: Axes, trials: Sequence[TrialResult]) -> None:
    width = 0.26
    for k, (metric, color) in enumerate(SIMILARITIES.items()):
        place = np.arange(len(trials)) + (k - 1) * width
        values = np.array([_value(t, metric) for t in trials])
        name = metric.short
        if np.isfinite(values).any():
            mean = float(np.nanmean(values))
            axes.axhline(mean, color=color, linestyle="--", linewidth=0.7, zorder=0.5)
            name = f"{name} {mean:.3f}"
        axes.bar(place, np.nan_to_num(values), width * 0.9, color=color, label=name)
        axes.plot(place, [_floor(t, metric) for t in trials], **FLOOR_STYLE)
    axes.set_ylim(min(0.0, *(axes.get_ylim()[0], 0.0)), 1.02)
    axes.set_ylabel("Score")
    axes.grid(axis="y")
    label_forces(axes, trials)
    handles, labels = axes.get_legend_handles_labels()
    handles += [
        Line2D([], [], color=GREY, linestyle="--", linewidth=0.7),
        Line2D([], [], **FLOOR_STYLE),
    ]
    legend_above(axes, handles, [*labels, "Mean", "No contact"], columns=5)
    letter(axes, "(b)")


def draw_errors(report: ValidationReport) -> Figure:
    """Draw bars of MSE and PSNR with their averages."""
    figure = new_figure(PAGE_IN, 2.0, marks=report.evidence.marks)
    left, right = figure.subplots(1, 2)
    statistics = report.statistics
    _draw_error_bars(left, report.trials, Metric.MSE, BLUE)
    _draw_error_bars(right, report.trials, Metric.PSNR_DB, GREEN)
    letter(left, "(a)")
    letter(right, "(b)")
    through = statistics.psnr_of_mean_mse_db
    if through is not None:
        right.axhline(through, color=ORANGE, linestyle=":", label=f"Of mean MSE {through:.2f}")
    for axes in (left, right):
        legend_above(axes, columns=3, x=0.55)
    return figure


def _draw_error_bars(axes: Axes, trials: Sequence[TrialResult], metric: Metric, color: str) -> None:
    values = np.array([_value(t, metric) for t in trials])
    place = np.arange(len(trials))
    axes.bar(place, np.nan_to_num(values), 0.62, color=color, alpha=0.85)
    if np.isfinite(values).any():
        mean = float(np.nanmean(values))
        axes.axhline(mean, color=ORANGE, linestyle="--", label=f"Mean {mean:.2f}")
    floors = [_floor(t, metric) for t in trials]
    axes.plot(place, floors, **(FLOOR_STYLE | {"markersize": 14}), label="No contact")
    axes.set_ylabel(metric.axis_label)
    axes.grid(axis="y")
    label_forces(axes, trials)


def _value(trial: TrialResult, metric: Metric) -> float:
    return _finite(trial.metrics, metric)


def _floor(trial: TrialResult, metric: Metric) -> float:
    return _finite(None if trial.floors is None else trial.floors.no_contact, metric)


def _finite(scores: ImageScores | None, metric: Metric) -> float:
    value = math.nan if scores is None else scores.value(metric)
    return value if math.isfinite(value) else math.nan
