"""What the benchmark's parts measured, as tables, and the figure of growth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from sim.studies.bench import Part
from sim.studies.bench.parts import (
    EXPONENT_WANTED,
    FORCE_ERROR_MAX,
    HELP_MAX_S,
    MEMORY_MAX_MIB,
    PRESS_MAX_S,
    TIME_MAX_S,
    GrowthRow,
    ReplayRow,
    StartRow,
    ThreadsRow,
    exponent,
    local_exponents,
)
from sim.studies.bench.rendering import BATCH, BLUR_PX, SAMPLES, RenderingRow, batch_device
from tacauchy_rig.core.figure_style import BLUE, GREY, INK, PAGE_IN, STYLE, save_figure
from tacauchy_rig.core.page import table_prose
from tacauchy_rig.core.tables import Table, table_of

_SHARE = 0.6
# Of an image [ms].
_ONE_MS, _OF_A_BATCH_MS = 5.0, 0.2
# 5,550 frames a second, ten times the paper's (with stress, GPU), leave as much for all of a frame.
_FROM_NODES_MS = 0.18
_ABSENT = f"{BATCH} images at once, which is done on a GPU: there is none here"
_prose = partial(table_prose, "sim.studies.bench", "tables.md.jinja")


def part_table(part: Part, rows: Sequence[Any]) -> Table:
    """Return the table of a part."""
    return _TABLES[part](rows)


def _rendering(rows: Sequence[RenderingRow]) -> Table:
    limits = {"one by one": _ONE_MS, "batch": _OF_A_BATCH_MS, "from nodes": _FROM_NODES_MS}
    judged = [row for row in rows if row.image_count in (1, BATCH)]
    return table_of(
        rows,
        {
            "sensor": lambda row: row.sensor,
            "renderer": lambda row: row.renderer,
            "device": lambda row: row.device,
            "images": lambda row: row.image_count,
            "samples": lambda row: f"{row.samples}x{row.samples}",
            "shadows": lambda row: row.shadow_count,
            "image [ms]": lambda row: row.image_ms,
            "least [ms]": lambda row: 1e3 * row.least_s / row.image_count,
            "apart [levels]": lambda row: row.apart_levels,
            "apart [%]": lambda row: 1e2 * row.apart_share,
        },
        passed=all(row.image_ms < limits[row.renderer] for row in judged)
        and all(row.apart_levels <= 1 for row in rows),
        **_prose(
            "rendering",
            one_ms=_ONE_MS,
            of_a_batch_ms=_OF_A_BATCH_MS,
            from_nodes_ms=_FROM_NODES_MS,
            batch=BATCH,
            first=rows[0],
            blur_px=f"{BLUR_PX:g}",
            samples=SAMPLES,
            absent=[] if batch_device() != "cpu" else [_ABSENT],
        ),
    )


def _replays(rows: Sequence[ReplayRow]) -> Table:
    within = [row for row in rows if row.is_within]
    return table_of(
        rows,
        {
            "preset": lambda row: row.setting,
            "presses": lambda row: row.trial_count,
            "F_z believed within [%]": lambda row: (
                None if row.force_error is None else 1e2 * row.force_error
            ),
            "iterations": lambda row: row.newton_iterations,
            "presses and fields [s]": lambda row: row.presses_s,
            "images [s]": lambda row: row.images_s,
            "together [s]": lambda row: row.wall_s,
            "peak memory [MiB]": lambda row: row.memory_mib,
        },
        passed=any(row.wall_s < TIME_MAX_S and row.memory_mib < MEMORY_MAX_MIB for row in within),
        **_prose(
            "replays",
            error_max=FORCE_ERROR_MAX,
            time_max_s=TIME_MAX_S,
            memory_max_mib=MEMORY_MAX_MIB,
            samples=SAMPLES,
        ),
    )


def _growth(rows: Sequence[GrowthRow]) -> Table:
    sizes = [float(row.tet_count) for row in rows]
    spent = [row.cpu_s for row in rows]
    each = [row.cpu_s / row.newton_iterations for row in rows]
    power = exponent(sizes, spent)
    steps = [None, *local_exponents(sizes, spent)]
    return table_of(
        list(zip(rows, each, steps, strict=True)),
        {
            "edges shorter by": lambda row: row[0].refinement,
            "tetrahedra": lambda row: row[0].tet_count,
            "nodes": lambda row: row[0].node_count,
            "iterations": lambda row: row[0].newton_iterations,
            "processor time [s]": lambda row: row[0].cpu_s,
            "of an iteration [ms]": lambda row: 1e3 * row[1],
            "exponent from the row above": lambda row: row[2],
        },
        passed=power <= EXPONENT_WANTED,
        **_prose(
            "growth",
            wanted=EXPONENT_WANTED,
            power=f"{power:.2f}",
            of_one=f"{exponent(sizes, each):.2f}",
        ),
    )


def _start(rows: Sequence[StartRow]) -> Table:
    return table_of(
        rows,
        {
            "what": lambda row: row.what,
            "processor time [s]": lambda row: row.cpu_s,
            "time [s]": lambda row: row.wall_s,
            "at most [s]": lambda row: row.limit_s,
        },
        passed=all(row.limit_s is None or row.cpu_s < row.limit_s for row in rows),
        **_prose("start", help_max=HELP_MAX_S, press_max=PRESS_MAX_S),
    )


def _threads(rows: Sequence[ThreadsRow]) -> Table:
    return table_of(
        rows,
        {
            "unknowns": lambda row: row.unknown_count,
            "threads": lambda row: row.thread_count,
            "factor [ms]": lambda row: 1e3 * row.factor_s,
            "processor time of it [ms]": lambda row: 1e3 * row.factor_cpu_s,
            "solution [ms]": lambda row: 1e3 * row.solve_s,
            "processor time of that [ms]": lambda row: 1e3 * row.solve_cpu_s,
        },
        **_prose("threads"),
    )


_TABLES: dict[Part, Callable[[Any], Table]] = {
    Part.RENDERING: _rendering,
    Part.REPLAY: _replays,
    Part.GROWTH: _growth,
    Part.START: _start,
    Part.THREADS: _threads,
}


def draw_growth(
    rows: Sequence[GrowthRow], folder: Path, *, page_folder: Path | None = None
) -> list[Path]:
    """Draw how presses grow with their elements, and write ``bench`` as PDF and PNG.

    Raises:
        RecordError: The files cannot be written.
    """
    sizes, times = [float(row.tet_count) for row in rows], [row.cpu_s for row in rows]
    fitted = exponent(sizes, times)
    middle = np.exp(np.log(sizes).mean()), np.exp(np.log(times).mean())
    with rc_context(STYLE):
        figure = Figure(figsize=(_SHARE * PAGE_IN, 2.6), layout="constrained")
        axes = figure.add_subplot()
        axes.loglog(sizes, times, "o", color=BLUE, markersize=4)
        for power, style, colour, text in (
            (fitted, "-", INK, f"$n^{{{fitted:.2f}}}$, fitted"),
            (EXPONENT_WANTED, ":", GREY, f"$n^{{{EXPONENT_WANTED:g}}}$"),
        ):
            line = middle[1] * (np.array(sizes) / middle[0]) ** power
            axes.loglog(sizes, line, style, color=colour, label=text)
        # The measured places of the axis are labelled, and no others.
        axes.set_xticks(sizes, [f"{place:.0f}" for place in sizes])
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xlabel("Tetrahedra $n$")
        axes.set_ylabel("Processor time of a press (s)")
        axes.set_title("Growth with elements", loc="left")
        axes.legend()
        return save_figure(figure, folder, "bench", page_folder=page_folder)
