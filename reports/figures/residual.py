"""What the residual inside the contact is made of, press by press and of all together."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from reports.comparison.results import TrialResult, ValidationReport
from reports.figures.trials import label_forces
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
