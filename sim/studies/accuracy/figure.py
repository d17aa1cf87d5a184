"""Error against time, on which a preset is chosen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sim.mesh.elements import ElementOrder
from sim.studies.accuracy.judging import error_bar
from sim.studies.accuracy.press import Row
from tacauchy_rig.core.figure_style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PAGE_IN,
    STYLE,
    save_figure,
)

_FLOOR = 1e-5
# Room for labels at the left and right ends, as factors of the time.
_LEFT, _RIGHT = 6.0, 2.5
# A gain on the front by a tenth can be seen.
_SEEN = 0.9
_LARGE = "force"
_TITLES = {
    _LARGE: "$F_z$ at equal depth",
    "depth": "Depth at equal $F_z$",
    "pressure": "Largest pressure",
    "height": "Height map (RMS)",
    "image": "Image (1 \N{MINUS SIGN} SSIM)",
}


def draw_rows(
    rows: Sequence[Row], bars: Mapping[str, float], folder: Path, *, page_folder: Path | None = None
) -> list[Path]:
    """Draw error against time, that of F_z large; write ``accuracy`` as PDF and PNG.

    Args:
        bars: By quantity: how far the reference itself may be off.

    Raises:
        RecordError: The files cannot be written.
    """
    with rc_context(STYLE):
        figure = Figure(figsize=(PAGE_IN, 4.6), layout="constrained")
        grid = figure.add_gridspec(2, 3, width_ratios=(2.4, 1.0, 1.0))
        for number, quantity in enumerate(_TITLES):
            small = divmod(number - 1, 2)
            place = grid[:, 0] if quantity == _LARGE else grid[small[0], 1 + small[1]]
            _draw_panel(figure.add_subplot(place), rows, bars[quantity], quantity)
        return save_figure(figure, folder, "accuracy", page_folder=page_folder)


def _draw_panel(axes: Axes, rows: Sequence[Row], bar: float, quantity: str) -> None:
    """Draw a quantity's errors; below ``bar``, the reference's own error, nothing is known."""
    large = quantity == _LARGE
    # The reference has no error against itself, and no place on a log axis.
    known = [row for row in rows if abs(row.errors[quantity]) > 0.0]
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_title(_TITLES[quantity], loc="left")
    axes.grid(visible=True, which="major")
    if not known:
        return
    sizes = {row.configuration.name: max(abs(row.errors[quantity]), _FLOOR) for row in known}
    for kind, marker, colour, text in (
        ((ElementOrder.P2, False), "o", BLUE, "quadratic (P2)"),
        ((ElementOrder.P1, False), "s", ORANGE, "linear (P1)"),
        ((ElementOrder.P2, True), "D", GREEN, "quadratic, corrected"),
    ):
        chosen = [row for row in known if _kind(row) == kind]
        if not chosen:
            continue
        tall = [sizes[row.configuration.name] for row in chosen]
        bars = [error_bar(bar, row.errors[quantity], row.chances[quantity]) for row in chosen]
        axes.errorbar(
            [row.time_s for row in chosen],
            tall,
            yerr=np.transpose([bar_ends(*pair) for pair in zip(tall, bars, strict=True)]),
            fmt=marker,
            markersize=4.5 if large else 3.0,
            color=colour,
            elinewidth=0.5,
            label=text,
        )
    if large:
        _draw_front(axes, known, sizes)
        _write_labels(axes, rows, sizes)
        left, right = axes.get_xlim()
        axes.set_xlim(left / _LEFT, right * _RIGHT)
        axes.set_xlabel("Set-up and solve (s)")
        axes.set_ylabel("Relative error")
    lowest = min(sizes.values())
    if bar > 0.0:
        axes.axhspan(0.2 * min(bar, lowest), bar, color=GREY, alpha=0.15, linewidth=0.0)
        label = "below the reference's own error" if large else None
        axes.axhline(bar, color=GREY, linewidth=0.5, linestyle=":", label=label)
    axes.set_ylim(bottom=0.5 * min(bar or np.inf, lowest))
    if large:
        axes.legend(loc="upper right")


def _kind(row: Row) -> tuple[ElementOrder, bool]:
    return row.configuration.element, row.configuration.is_corrected


def bar_ends(size: float, bar: float) -> tuple[float, float]:
    """Return how far an error bar goes down and up; on a log axis it cannot reach zero."""
    return min(bar, 0.9 * size), bar


def _draw_front(axes: Axes, rows: Sequence[Row], sizes: dict[str, float]) -> None:
    front = sorted((row.time_s, sizes[row.configuration.name]) for row in rows if row.on_front)
    axes.plot(*zip(*front, strict=True), color=INK, linewidth=0.8, label="Pareto front", zorder=1)


def _write_labels(axes: Axes, rows: Sequence[Row], sizes: dict[str, float]) -> None:
    """Name presets above their points, in bold, and below them what gains on the front."""
    least = np.inf
    for row in sorted(rows, key=lambda row: row.time_s):
        name, is_preset = row.configuration.name, row.configuration.is_preset
        error = abs(row.errors[_LARGE])
        gains = row.on_front and error < _SEEN * least
        least = min(least, error) if row.on_front else least
        if name not in sizes or not (gains or is_preset):
            continue
        axes.annotate(
            name.replace("d_hat", r"$\hat{d}$"),
            (row.time_s, sizes[name]),
            xytext=(4, 4) if is_preset else (-5, -4),
            ha="left" if is_preset else "right",
            va="bottom" if is_preset else "top",
            textcoords="offset points",
            fontsize=6.5,
            fontweight="bold" if is_preset else "normal",
            color=INK if row.on_front else GREY,
        )
