"""The benchmark's figure: how presses grow with their elements, and with environments."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from sim.studies.bench.batches import BatchRow
from sim.studies.bench.growth import EXPONENT_WANTED, GrowthRow, exponent
from sim.studies.bench.suite import Benchmark
from tacauchy_rig.figure_style import BLUE, GREY, INK, PAGE_IN, STYLE, save_figure

_ALONE_SHARE = 0.6


def draw_bench(found: Benchmark, *, folder: Path, name: str = "bench") -> list[Path]:
    """Draw what was measured of growth and batches, and write ``name`` as PDF and PNG.

    Returns:
        The files; none where there is nothing to draw.

    Raises:
        RecordError: The files cannot be written.
    """
    drawn: list[Callable[[Axes], None]] = []
    if found.growth:
        drawn.append(lambda axes: _draw_growth(axes, found.growth))
    if found.batches:
        drawn.append(lambda axes: _draw_batches(axes, found.batches))
    if not drawn:
        return []
    with rc_context(STYLE):
        width_in = PAGE_IN * (1.0 if len(drawn) > 1 else _ALONE_SHARE)
        figure = Figure(figsize=(width_in, 2.6), layout="constrained")
        for number, draw in enumerate(drawn):
            draw(figure.add_subplot(1, len(drawn), number + 1))
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


def _draw_batches(axes: Axes, rows: Sequence[BatchRow]) -> None:
    counts, speeds = [row.environments for row in rows], [row.frames_per_s for row in rows]
    axes.loglog(counts, speeds, "o-", color=BLUE, markersize=4)
    _mark(axes, counts)
    # Whole decades: an axis of less has labels that nobody can read.
    axes.set_ylim(10 ** np.floor(np.log10(min(speeds))), 10 ** np.ceil(np.log10(max(speeds))))
    axes.set_xlabel("Environments")
    axes.set_ylabel("Frames a second, all together")
    axes.set_title("Growth with environments", loc="left")


def _mark(axes: Axes, measured: Sequence[float]) -> None:
    """Label the measured places of a logarithmic axis and no others."""
    axes.set_xticks(measured, [f"{place:.0f}" for place in measured])
    axes.xaxis.set_minor_formatter(NullFormatter())
