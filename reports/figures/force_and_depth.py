"""Force and depth, contact pressure, and the uncertainty of the predicted force."""

import math
from collections.abc import Sequence
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from reports.comparison.result_types import TrialResult, ValidationReport
from reports.evidence.evidence_types import Curve, RunEvidence, TrialEvidence
from reports.figures.trial_axis import force_title, shown
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.plot_style import (
    BLUE,
    COLUMN_IN,
    GREEN,
    GREY,
    LIGHT,
    ORANGE,
    PAGE_IN,
    PURPLE,
    SKY,
    new_figure,
)
from tacauchy_rig.core.simulated import ForceDepthCurve

MAX_POINTS = 1500
FEW_POINTS = 60  # of a curve, which are marked each
KINDS = (ORANGE, GREEN, PURPLE, SKY)
KINDS_MOST = 6  # of curves: more hide one another
MARGIN_S = 1.5


def draw_time_curves(evidence: RunEvidence) -> Figure:
    """Draw force above depth over time, one column a trial; the dwell that counts is shaded."""
    trials = shown(evidence.trials)
    figure = new_figure(PAGE_IN, 2.5, marks=evidence.marks)
    grid = figure.subplots(2, len(trials), sharex="col", sharey="row", squeeze=False)
    for column, trial in enumerate(trials):
        force, depth = grid[0, column], grid[1, column]
        _draw_curve(force, trial.force_curve, BLUE, 1.0)
        _draw_curve(depth, trial.depth_curve, GREEN, 1e3)
        if not math.isnan(trial.force_target_n):
            force.axhline(trial.force_target_n, color=ORANGE, linestyle="--", linewidth=0.7)
        force.set_title(force_title(trial))
        if trial.force_curve is None:
            depth.text(0.5, 0.5, "not recorded", transform=depth.transAxes, ha="center", color=GREY)
        depth.axhline(0.0, color=GREY, linewidth=0.4)
        if trial.dwell_s is not None:
            for axes in (force, depth):
                axes.axvspan(*trial.dwell_s, color=LIGHT, linewidth=0, zorder=0)
            depth.set_xlim(*_time_limits(trial, trial.dwell_s))
    grid[0, 0].set_ylabel("$F_z$ (N)")
    grid[1, 0].set_ylabel("Depth (mm)")
    grid[1, 0].set_ylim(*_depth_limits(trials))
    figure.supxlabel("Time from the start of the dwell (s)", fontsize=8)
    return figure


def _draw_curve(axes: Axes, curve: Curve | None, color: str, factor: float) -> None:
    if curve is not None and len(curve.time_s):
        some = slice(None, None, max(1, len(curve.time_s) // MAX_POINTS))
        axes.plot(curve.time_s[some], curve.value[some] * factor, color=color, linewidth=0.8)
    axes.grid(axis="y")


def _time_limits(trial: TrialEvidence, dwell_s: tuple[float, float]) -> tuple[float, float]:
    start, end = dwell_s[0], dwell_s[1] + MARGIN_S
    if trial.depth_curve is not None:
        before = trial.depth_curve.time_s[
            (trial.depth_curve.value > 0.0) & (trial.depth_curve.time_s < dwell_s[0])
        ]
        start = float(before[0]) if len(before) else start
    return start - MARGIN_S, end


def _depth_limits(trials: Sequence[TrialEvidence]) -> tuple[float, float]:
    curves = [t.depth_curve for t in trials if t.depth_curve is not None]
    top = max([0.1, *(float(c.value.max()) * 1e3 for c in curves if len(c.value))])
    return -0.5 * top, 1.15 * top


def draw_force_depth(report: ValidationReport) -> Figure:
    """Draw measured and simulated force over depth, and below by how much the latter is off."""
    figure = new_figure(COLUMN_IN, 3.6, marks=report.evidence.marks)
    axes, errors = figure.subplots(2, 1, height_ratios=(3, 2))
    label: str | None = "Measured, loading"
    for trial in report.evidence.trials:
        points = loading_branch(trial)
        if points is not None:
            axes.plot(points[:, 0] * 1e3, points[:, 1], color=BLUE, alpha=0.3, label=label)
            label = None
    _draw_simulated(axes, report)
    _draw_dwell_points(axes, report.trials)
    _draw_errors(errors, report.trials)
    axes.set_xlabel("Depth below first contact (mm)")
    axes.set_ylabel("$F_z$ (N)")
    axes.set_xlim(left=0.0)
    axes.set_ylim(bottom=0.0)
    axes.grid(visible=True)
    axes.legend(loc="upper left")
    return figure


def _draw_simulated(axes: Axes, report: ValidationReport) -> None:
    """Draw the simulator's curve with the stated modulus and, where it was fitted, with that.

    Trials of one indenter at one place have one curve: they were replayed with one model.
    """
    evidence = report.evidence
    by_kind = {t.kind: t for t in evidence.trials if t.force_depth_simulated is not None}
    shown_kinds = dict(list(by_kind.items())[:KINDS_MOST])
    for (kind, trial), colour in zip(shown_kinds.items(), cycle(KINDS), strict=False):
        curve, model = trial.force_depth_simulated, evidence.model_of(trial.index)
        if curve is None:
            continue
        factor = None if model is None else model.modulus_factor
        named = f"{model.indenter}: " if model is not None and len(by_kind) > 1 else ""
        axes.plot(
            _from_contact(curve, evidence.contact_force_n),
            curve.force_n,
            color=colour,
            marker="." if len(curve.depth_m) < FEW_POINTS else None,
            markersize=3,
            label=f"{named}Simulated" if factor is None else f"{named}Simulated, nominal modulus",
        )
        if factor is not None:
            label = f"{factor:.3f} times that" if kind == min(by_kind) else None
            depth_mm = _from_contact(curve, evidence.contact_force_n / factor)
            axes.plot(depth_mm, factor * curve.force_n, "--", color=colour, label=label)


def _from_contact(curve: ForceDepthCurve, force_n: float) -> FloatArray:
    """Return a simulated curve's depths [mm], counted from a force as recorded ones are."""
    return (curve.depth_m - (curve.depth_at(force_n) or 0.0)) * 1e3


def _draw_dwell_points(axes: Axes, trials: Sequence[TrialResult]) -> None:
    points = [
        (t.depth_measured_m * 1e3, t.force_measured_n)
        for t in trials
        if t.depth_measured_m is not None and t.force_measured_n is not None
    ]
    if points:
        axes.plot(*zip(*points, strict=True), "o", color=BLUE, ms=3.5, label="Measured, dwell mean")


def _draw_errors(axes: Axes, trials: Sequence[TrialResult]) -> None:
    """Draw the error of the predicted force with its 95 % interval."""
    found = [
        (
            t.force_measured_n,
            100.0 * (t.force.prediction_error_n or 0.0) / t.force_measured_n,
            100.0 * t.force.combined.expanded_n / t.force_measured_n,
        )
        for t in trials
        if t.force_measured_n and t.force.combined and t.force.prediction_error_n is not None
    ]
    axes.axhline(0.0, color=GREY, linewidth=0.5)
    if found:
        force_n, error, interval = zip(*found, strict=True)
        axes.errorbar(
            force_n, error, interval, fmt="o", color=ORANGE, ms=3.5, capsize=1.5, elinewidth=0.6
        )
    axes.set_xlabel("Measured $F_z$ (N)")
    axes.set_ylabel("Predicted − measured (%)")
    axes.grid(axis="y")


def loading_branch(trial: TrialEvidence) -> FloatArray | None:
    """Return (depth [m], force [N]) from first contact to the end of the dwell, shape [n, 2]."""
    force, depth = trial.force_curve, trial.depth_curve
    if force is None or depth is None or len(force.time_s) < 2 or len(depth.time_s) < 2:
        return None
    travel = np.interp(force.time_s, depth.time_s, depth.value)
    end = trial.dwell_s[1] if trial.dwell_s is not None else float(force.time_s[-1])
    kept = (travel > 0.0) & (force.time_s <= end)
    return np.stack([travel[kept], force.value[kept]], axis=1) if kept.any() else None
