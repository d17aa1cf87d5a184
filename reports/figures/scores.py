"""The five scores over the target forces, each with its mean and its no-contact floor."""

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
from tacauchy_rig.core.figure_style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PAGE_IN,
    letter,
    new_figure,
)

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
