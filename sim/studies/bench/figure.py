"""The benchmark's figure: how presses grow with their elements."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from sim.studies.bench.growth import EXPONENT_WANTED, GrowthRow, exponent
from sim.studies.bench.suite import Benchmark
from tacauchy_rig.core.figure_style import BLUE, GREY, INK, PAGE_IN, STYLE, save_figure

_SHARE = 0.6


def draw_bench(found: Benchmark, *, folder: Path, name: str = "bench") -> list[Path]:
    """Draw what was measured of growth, and write ``name`` as PDF and PNG.

    Returns:
        The files; none where there is nothing to draw.

    Raises:
        RecordError: The files cannot be written.
    """
    if not found.growth:
        return []
    with rc_context(STYLE):
        figure = Figure(figsize=(_SHARE * PAGE_IN, 2.6), layout="constrained")
        _draw_growth(figure.add_subplot(), found.growth)
        return save_figure(figure, folder, name)


def _draw_growth(axes: Axes, rows: Sequence[GrowthRow]) -> None:
    sizes, times = [float(row.tet_count) for row in rows], [row.cpu_s for row in rows]
    fitted = exponent(sizes, times)
    middle = np.exp(np.log(sizes).mean()), np.exp(np.log(times).mean())
    axes.loglog(sizes, times, "o", color=BLUE, markersize=4)
    for power, style, colour, text in (
        (fitted, "-", INK, f"$n^{{{fitted:.2f}}}$, fitted"),
        (EXPONENT_WANTED, ":", GREY, f"$n^{{{EXPONENT_WANTED:g}}}$"),
    ):
        line = middle[1] * (np.array(sizes) / middle[0]) ** power
        axes.loglog(sizes, line, style, color=colour, label=text)
    _mark(axes, sizes)
    axes.set_xlabel("Tetrahedra $n$")
    axes.set_ylabel("Processor time of a press (s)")
    axes.set_title("Growth with elements", loc="left")
    axes.legend()


def _mark(axes: Axes, measured: Sequence[float]) -> None:
    """Label the measured places of a logarithmic axis and no others."""
    axes.set_xticks(measured, [f"{place:.0f}" for place in measured])
    axes.xaxis.set_minor_formatter(NullFormatter())
