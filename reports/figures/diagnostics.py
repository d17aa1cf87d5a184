"""Contact scores, arrival of the streams, and the truth of a dry run recovered."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from reports.comparison.results import TrialResult, ValidationReport
from reports.figures.trials import label_forces
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.figure_style import (
    BLUE,
    COLUMN_IN,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PAGE_IN,
    letter,
    new_figure,
)

STREAMS = {"force": ("Force", BLUE), "image": ("Images", ORANGE), "arm": ("Arm", GREEN)}


def draw_contact(report: ValidationReport) -> Figure:
    """Draw the contact's correlation and residual, raw and with pose and light taken out."""
    figure = new_figure(PAGE_IN, 1.9, marks=report.evidence.marks)
    left, right = figure.subplots(1, 2)
    _draw_contact_score(left, report.trials, "zncc")
    _draw_contact_score(right, report.trials, "relative_residual")
    floors = np.array([t.contact_no_contact_residual for t in report.trials], dtype=np.float64)
    right.plot(floors, color=INK, marker="_", ls="none", label="No contact")
    left.set_ylabel("ZNCC in the contact")
    right.set_ylabel(f"Residual / {report.evidence.camera} change")
    right.set_ylim(bottom=0.0)
    for axes, name in ((left, "(a)"), (right, "(b)")):
        axes.grid(axis="y")
        label_forces(axes, report.trials)
        letter(axes, name)
    right.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, borderpad=0.1)
    left.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, borderpad=0.1)
    return figure


def _draw_contact_score(axes: Axes, trials: Sequence[TrialResult], name: str) -> None:
    fitted = [t.corrections and t.corrections.contact_pose_light_corrected for t in trials]
    raw, corrected = (
        [getattr(scores, name, math.nan) for scores in of]
        for of in ([t.contact for t in trials], fitted)
    )
    axes.plot(raw, color=BLUE, marker="o", markersize=3, label="Raw")
    axes.plot(
        corrected,
        color=GREEN,
        marker="s",
        markersize=3,
        markerfacecolor="white",
        linestyle=":",
        label="Pose and light taken out",
    )


def draw_arrival(report: ValidationReport) -> Figure:
    """Draw, per stream, which part of the samples arrived later than a given interval."""
    figure = new_figure(PAGE_IN, 1.9, marks=report.evidence.marks)
    panels = figure.subplots(1, len(STREAMS), sharey=True)
    for axes, (name, (title, color)) in zip(panels, STREAMS.items(), strict=True):
        streams = [s for t in report.evidence.trials for s in t.streams if s.name == name]
        intervals = [s.intervals_s for s in streams if len(s.intervals_s)]
        axes.set_xlabel("Interval between arrivals (ms)")
        axes.grid(visible=True)
        if not intervals:
            axes.set_title(f"{title}: not recorded")
            continue
        pooled = np.concatenate(intervals)
        _draw_survival(axes, pooled * 1e3, color)
        counted = [s.lost_count for s in streams if s.lost_count is not None]
        lost = f", {sum(counted)} lost" if counted else ""
        axes.set_title(f"{title}: {len(pooled) / pooled.sum():.2f} Hz{lost}", fontsize=7.5)
        nominal = next((s.nominal_rate_hz for s in streams if s.nominal_rate_hz), None)
        if nominal:
            axes.axvline(1e3 / nominal, color=GREY, linestyle="--", linewidth=0.7)
    panels[0].set_ylabel("Part that came later")
    panels[0].set_yscale("log")
    return figure


def _draw_survival(axes: Axes, intervals_ms: FloatArray, color: str) -> None:
    ordered = np.sort(intervals_ms)
    later = 1.0 - np.arange(len(ordered)) / len(ordered)
    axes.step(ordered, later, where="post", color=color)
    axes.set_xlim(left=0.0, right=float(ordered[-1]) * 1.08)


def draw_truth(report: ValidationReport) -> Figure:
    """Draw recovered minus true values of the emulated world: lengths in um, the rest in %."""
    lengths = [(c.name, 1e3 * (c.recovered - c.true)) for c in report.truth if c.unit == "mm"]
    others = [
        (c.name, 100.0 * (c.recovered - c.true) / abs(c.true))
        for c in report.truth
        if c.unit != "mm" and c.true != 0.0
    ]
    panels = [
        (rows, label)
        for rows, label in ((others, "Recovered − true (%)"), (lengths, "Recovered − true (µm)"))
        if rows
    ]
    counts = [len({name for name, _ in rows}) for rows, _ in panels]
    figure = new_figure(
        COLUMN_IN,
        0.55 * len(panels) + 0.19 * sum(counts),
        marks=report.evidence.marks,
    )
    grid = figure.subplots(len(panels), 1, squeeze=False, height_ratios=counts)
    for axes, (rows, label) in zip(grid[:, 0], panels, strict=True):
        _draw_errors(axes, rows, label)
    return figure


def _draw_errors(axes: Axes, rows: Sequence[tuple[str, float]], label: str) -> None:
    names = list(dict.fromkeys(name for name, _ in rows))
    axes.axvline(0.0, color=GREY, linewidth=0.6)
    axes.plot(
        [error for _, error in rows],
        [names.index(name) for name, _ in rows],
        color=BLUE,
        marker="o",
        markersize=3,
        markeredgewidth=0,
        alpha=0.6,
        ls="none",
    )
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_xlabel(label)
    axes.grid(axis="x")
