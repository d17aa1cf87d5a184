"""Error against wall time, on which a preset is chosen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from reports.figures.style import BLUE, GREY, INK, ORANGE, PAGE_IN, PNG_DPI, STYLE

_FLOOR = 1e-5
# Room for labels at the left and right ends, as factors of the time.
_LEFT, _RIGHT = 6.0, 2.5


@dataclass(frozen=True, slots=True, kw_only=True)
class CostPoint:
    """A configuration in the figure.

    Attributes:
        errors: By quantity, with or without sign.
        bars: How far each may be off, by quantity.
        label: Written beside the point where it is not empty.
    """

    time_s: float
    errors: Mapping[str, float]
    on_front: bool
    is_linear_element: bool
    bars: Mapping[str, float]
    label: str = ""
    is_preset: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Panel:
    """One quantity of the figure."""

    quantity: str
    title: str


def draw_accuracy(
    points: Sequence[CostPoint],
    bars: Mapping[str, float],
    panels: Sequence[Panel],
    *,
    folder: Path,
    name: str = "accuracy",
) -> list[Path]:
    """Draw error against time and write ``name`` as PDF and PNG.

    Args:
        points: What was measured.
        bars: The reference's own error by quantity; nothing below it is known.
        panels: The first is drawn large, the others small.

    Returns:
        The files.
    """
    with rc_context(STYLE):
        figure = Figure(figsize=(PAGE_IN, 4.6), layout="constrained")
        grid = figure.add_gridspec(2, 3, width_ratios=(2.4, 1.0, 1.0))
        main = figure.add_subplot(grid[:, 0])
        small = [figure.add_subplot(grid[row, column]) for row in (0, 1) for column in (1, 2)]
        for axes, panel in zip([main, *small], panels, strict=False):
            _draw_panel(axes, points, bars.get(panel.quantity, 0.0), panel, large=axes is main)
        for axes in small[len(panels) - 1 :]:
            axes.remove()
        folder.mkdir(parents=True, exist_ok=True)
        files = [folder / f"{name}.pdf", folder / f"{name}.png"]
        for file in files:
            figure.savefig(file, dpi=PNG_DPI)
    return files


def _draw_panel(
    axes: Axes, points: Sequence[CostPoint], bar: float, panel: Panel, *, large: bool
) -> None:
    # The reference has no error against itself, and no place on a log axis.
    known = [p for p in points if abs(p.errors.get(panel.quantity, 0.0)) > 0.0]
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_title(panel.title, loc="left")
    axes.grid(visible=True, which="major")
    if not known:
        return
    sizes = [max(abs(p.errors[panel.quantity]), _FLOOR) for p in known]
    for linear, marker, text in ((False, "o", "quadratic (P2)"), (True, "s", "linear (P1)")):
        chosen = [k for k, p in enumerate(known) if p.is_linear_element is linear]
        if not chosen:
            continue
        axes.errorbar(
            [known[k].time_s for k in chosen],
            [sizes[k] for k in chosen],
            yerr=_both(sizes, [known[k].bars.get(panel.quantity, 0.0) for k in chosen], chosen),
            fmt=marker,
            markersize=4.5 if large else 3.0,
            color=ORANGE if linear else BLUE,
            elinewidth=0.5,
            label=text,
        )
    if large:
        _draw_front(axes, known, panel.quantity)
        _write_labels(axes, known, sizes)
        left, right = axes.get_xlim()
        axes.set_xlim(left / _LEFT, right * _RIGHT)
        axes.set_xlabel("Set-up and solve (s)")
        axes.set_ylabel("Relative error")
    if bar > 0.0:
        axes.axhspan(0.2 * min([bar, *sizes]), bar, color=GREY, alpha=0.15, linewidth=0.0)
        label = "below the reference's own error" if large else None
        axes.axhline(bar, color=GREY, linewidth=0.5, linestyle=":", label=label)
    axes.set_ylim(bottom=0.5 * min([bar or np.inf, *sizes]))
    if large:
        axes.legend(loc="upper right")


def bar_ends(size: float, bar: float) -> tuple[float, float]:
    """Return how far an error bar goes down and up; on a log axis it cannot reach zero."""
    return min(bar, 0.9 * size), bar


def _both(
    sizes: Sequence[float], bars: Sequence[float], chosen: Sequence[int]
) -> list[list[float]]:
    ends = [bar_ends(sizes[k], bar) for k, bar in zip(chosen, bars, strict=True)]
    return [[down for down, _ in ends], [up for _, up in ends]]


def _draw_front(axes: Axes, points: Sequence[CostPoint], quantity: str) -> None:
    front = sorted((p.time_s, max(abs(p.errors[quantity]), _FLOOR)) for p in points if p.on_front)
    axes.plot(*zip(*front, strict=True), color=INK, linewidth=0.8, label="Pareto front", zorder=1)


def _write_labels(axes: Axes, points: Sequence[CostPoint], sizes: Sequence[float]) -> None:
    """Name presets above their points, in bold, and others below."""
    for point, size in zip(points, sizes, strict=True):
        axes.annotate(
            point.label,
            (point.time_s, size),
            xytext=(4, 4) if point.is_preset else (-5, -4),
            ha="left" if point.is_preset else "right",
            va="bottom" if point.is_preset else "top",
            textcoords="offset points",
            fontsize=6.5,
            fontweight="bold" if point.is_preset else "normal",
            color=INK if point.on_front else GREY,
        )
