"""The benchmark's figure: the parts of the work, and how a press grows with its elements."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from reports.figures.style import BLUE, GREEN, GREY, INK, ORANGE, PAGE_IN, PNG_DPI, STYLE

_COLOURS = (BLUE, ORANGE, GREEN)


@dataclass(frozen=True, slots=True, kw_only=True)
class Growth:
    """Sizes and times, and the power law through them."""

    sizes: Sequence[float]
    times_s: Sequence[float]
    exponent: float
    limit: float


def draw_bench(
    parts_ms: Mapping[str, Mapping[str, float]],
    growth: Growth | None,
    batches: Sequence[tuple[int, float]],
    *,
    folder: Path,
    name: str = "bench",
) -> list[Path]:
    """Draw and write ``name`` as PDF and PNG.

    Args:
        parts_ms: By preset, what each part takes [ms]; empty for none.
        growth: None if it was not measured.
        batches: Environments side by side and frames of all of them a second; empty for none.

    Returns:
        The files.
    """
    with rc_context(STYLE):
        drawn: list[Callable[[Axes], None]] = []
        if parts_ms:
            drawn.append(partial(_draw_parts, parts_ms=parts_ms))
        if growth is not None:
            drawn.append(partial(_draw_growth, growth=growth))
        if batches:
            drawn.append(partial(_draw_batches, batches=batches))
        if not drawn:
            return []
        figure = Figure(
            figsize=(PAGE_IN * (1.0 if len(drawn) > 1 else 0.6), 2.6), layout="constrained"
        )
        for number, draw in enumerate(drawn):
            draw(figure.add_subplot(1, len(drawn), number + 1))
        folder.mkdir(parents=True, exist_ok=True)
        files = [folder / f"{name}.pdf", folder / f"{name}.png"]
        for file in files:
            figure.savefig(file, dpi=PNG_DPI)
    return files


def _draw_parts(axes: Axes, parts_ms: Mapping[str, Mapping[str, float]]) -> None:
    names = list(dict.fromkeys(name for parts in parts_ms.values() for name in parts))
    height = 0.8 / len(parts_ms)
    for k, (preset, parts) in enumerate(parts_ms.items()):
        axes.barh(
            [n + (k - 0.5 * (len(parts_ms) - 1)) * height for n in range(len(names))],
            [parts[name] for name in names],
            height=0.9 * height,
            color=_COLOURS[k % len(_COLOURS)],
            label=preset,
        )
    axes.set_xscale("log")
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set_xlabel("Time (ms)")
    axes.set_title("Parts of the work", loc="left")
    axes.legend()


def _draw_growth(axes: Axes, growth: Growth) -> None:
    sizes, times = np.array(growth.sizes), np.array(growth.times_s)
    middle = np.exp(np.log(sizes).mean()), np.exp(np.log(times).mean())
    axes.loglog(sizes, times, "o", color=BLUE, markersize=4)
    for power, style, colour, text in (
        (growth.exponent, "-", INK, f"$n^{{{growth.exponent:.2f}}}$, fitted"),
        (growth.limit, ":", GREY, f"$n^{{{growth.limit:g}}}$"),
    ):
        axes.loglog(
            sizes, middle[1] * (sizes / middle[0]) ** power, style, color=colour, label=text
        )
    _mark(axes, growth.sizes)
    axes.set_xlabel("Tetrahedra $n$")
    axes.set_ylabel("Processor time of a press (s)")
    axes.set_title("Growth with elements", loc="left")
    axes.legend()


def _draw_batches(axes: Axes, batches: Sequence[tuple[int, float]]) -> None:
    counts, speeds = zip(*batches, strict=True)
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
