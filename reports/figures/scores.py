"""The image scores over the target forces, each on an axis of its own, with what bounds them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes

from reports.comparison.results import TrialResult, ValidationReport
from reports.figures.trials import force_label, label_forces, shown
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
LINES: dict[str, dict[str, Any]] = {
    "Simulated": {"color": BLUE, "marker": "o", "markersize": 3},
    "No contact": {"color": INK, "marker": "_", "ls": "none", "markersize": 7},
    "Best wrong force": {"color": ORANGE, "marker": "x", "ls": "none", "markersize": 3.5},
    "Ceiling": {"color": GREY, "ls": "--", "lw": 0.7},
    "Position and light removed": {"color": GREEN, "marker": "s", "markersize": 2.5, "ls": ":"},
}
"""Of each panel, in the order of the legend."""


def draw_scores(report: ValidationReport) -> Figure:
    """Draw a radar chart of the similarities and a panel for every score."""
    trials = sorted(report.trials, key=lambda t: (math.isnan(t.force_target_n), t.force_target_n))
    figure = new_figure(PAGE_IN, 3.7, marks=report.evidence.marks)
    grid = figure.add_gridspec(2, 4)
    radar = figure.add_subplot(grid[0, 0], projection="polar")
    if isinstance(radar, PolarAxes):
        _draw_radar(radar, shown(trials))
    places = [(0, 1), (0, 2), (0, 3), (1, 0), (1, 1)]
    panels = [figure.add_subplot(grid[place]) for place in places]
    for axes, metric in zip(panels, Metric, strict=True):
        _draw_panel(axes, trials, metric.axis_label, _of_frame(trials, metric))
    panels[-1].set_yscale("log")
    contact = [figure.add_subplot(grid[1, column]) for column in (2, 3)]
    _draw_panel(contact[0], trials, "ZNCC in the contact", _of_contact(trials, "zncc"))
    residuals = _of_contact(trials, "relative_residual")
    residuals["No contact"] = [_number(t.contact_no_contact_residual) for t in trials]
    _draw_panel(contact[1], trials, "Residual in the contact", residuals)
    for axes, name in zip((radar, *panels, *contact), "abcdefgh", strict=True):
        letter(axes, f"({name})")
    handles: dict[str, Artist] = {}
    for axes in (*panels, *contact):
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
