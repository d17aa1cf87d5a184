"""The figure of the benchmark's scenes: frames a second of each, in every way it was pressed."""

from __future__ import annotations

import math
from pathlib import Path

from matplotlib import rc_context
from matplotlib.figure import Figure

from sim.studies.bench.scenes.suite import SceneBench
from sim.studies.bench.scenes.tables import way
from tacauchy_rig.core.figure_style import (
    BLUE,
    COLUMN_IN,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    STYLE,
    save_figure,
)

_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY)
# Of a bar, of a scene at least, and of the axis with its labels and the legend [inch].
_BAR_IN, _SCENE_IN, _LABELS_IN = 0.1, 0.16, 1.0


def draw_scenes(found: SceneBench, *, folder: Path) -> list[Path]:
    """Draw bars on a logarithmic axis and write ``scenes`` as PDF and PNG; nothing without rows.

    Raises:
        RecordError: The files cannot be written.
    """
    groups = [rows for rows in found.groups if any(row.press for row in rows)]
    if not groups:
        return []
    names = [row.scene for row in groups[0]]
    height = 0.8 / len(groups)
    with rc_context(STYLE):
        tall = _LABELS_IN + len(names) * max(_SCENE_IN, _BAR_IN * len(groups))
        figure = Figure(figsize=(1.4 * COLUMN_IN, tall), layout="constrained")
        axes = figure.add_subplot()
        for k, rows in enumerate(groups):
            places = [n + (k - 0.5 * (len(groups) - 1)) * height for n in range(len(rows))]
            axes.barh(
                places,
                [row.frames_per_s if row.press else 0.0 for row in rows],
                height=0.9 * height,
                color=_COLOURS[k % len(_COLOURS)],
                hatch="////" * (k // len(_COLOURS)),
                label=way(rows[0]),
            )
        axes.set_xscale("log")
        least = min(row.frames_per_s for rows in groups for row in rows if row.press)
        # An axis that began at the least would make a slow scene look like none.
        axes.set_xlim(left=10.0 ** math.floor(math.log10(least)))
        axes.set_yticks(range(len(names)), names)
        axes.invert_yaxis()
        axes.grid(axis="x")
        axes.set_xlabel("Frames a second")
        figure.legend(loc="outside upper right", ncols=2)
        return save_figure(figure, folder, "scenes")
