"""The benchmark's scenes as tables, and their figure."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import nan
from pathlib import Path
from statistics import geometric_mean

from matplotlib import rc_context
from matplotlib.figure import Figure

from sim.error import parse_tolerance
from sim.studies.bench.scenes import FRAME_COUNT, IMAGES, Reference, ScenePress, SceneRow
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
from tacauchy_rig.core.page import table_prose
from tacauchy_rig.core.tables import Cell, Table, table_of

# Frames a second that are wanted of presses alone on one thread, mean and least: by tolerance.
_WANTED_ALONE: dict[str, tuple[float, float]] = {"5%": (60.0, 15.0), "1%": (25.0, 0.0)}
# The same of others at 5 %: by kind of device, environments, manner.
_WANTED: dict[tuple[bool, int | None, tuple[str, ...]], tuple[float, float]] = {
    (False, None, ()): (300.0, 300.0),
    (False, 1, ()): (300.0, 300.0),
    (False, 60, ()): (10_000.0, 10_000.0),
    (False, 60, (IMAGES,)): (5_550.0, 5_550.0),
}
_JUDGED = "5%"
# From here on frames a second are shown as whole numbers.
_WHOLE = 100.0
_prose = partial(table_prose, "sim.studies.bench", "scenes.md.jinja")


def scene_tables(rows: Sequence[SceneRow], references: Mapping[str, Reference]) -> list[Table]:
    """Return the tables of scenes that were pressed in one manner."""
    tables = [_speed(rows), _forces(rows, references), _work(rows)]
    if any(row.press and row.press.parts_s for row in rows):
        tables.append(_launches(rows))
    return tables


def _speed(rows: Sequence[SceneRow]) -> Table:
    manner = rows[0].manner
    found = [row.frames_per_s for row in rows if row.press]
    is_cpu = manner.device == "cpu"
    wanted = _WANTED.get((is_cpu, manner.environments, manner.extras))
    if manner.environments is None and is_cpu:
        wanted = _WANTED_ALONE.get(manner.tolerance)
    elif manner.environments is None and manner.tolerance != _JUDGED:
        wanted = None
    mean, least = geometric_mean(found) if found else nan, min(found, default=0.0)
    return table_of(
        rows,
        {
            "scene": lambda row: row.scene,
            "preset": lambda row: row.setting,
            "frames/s": lambda row: None if row.press is None else _counted(row.frames_per_s),
            "processor [s]": _each(lambda press: press.cpu_s),
            "wall [s]": _each(lambda press: press.wall_s),
        },
        passed=wanted is None
        or (len(found) == len(rows) and mean >= wanted[0] and least >= wanted[1]),
        **_prose(
            "speed",
            way=manner.text,
            wanted=wanted,
            mean=f"{mean:.1f}",
            least=f"{least:.1f}",
            measured=len(found),
            count=len(rows),
            frames=FRAME_COUNT,
            is_cpu=is_cpu,
        ),
    )


def _forces(rows: Sequence[SceneRow], references: Mapping[str, Reference]) -> Table:
    text = rows[0].manner.tolerance if any(row.scene in references for row in rows) else ""
    allowed = parse_tolerance(text, field="--tolerance") if text else None

    def error(row: SceneRow) -> float | None:
        known = references.get(row.scene)
        return None if known is None or row.press is None else known.error(row.press)

    def sideways(row: SceneRow) -> Cell:
        known = references.get(row.scene)
        off = None if known is None or row.press is None else known.sideways_error(row.press)
        return _percent(off)

    def raw(row: SceneRow) -> float | None:
        known = references.get(row.scene)
        return None if known is None or row.press is None else known.raw_error(row.press)

    def stated(press: ScenePress) -> Cell:
        return _percent(None if press.corrected is None else press.corrected.error_relative)

    errors = [error(row) for row in rows]
    return table_of(
        rows,
        {
            "scene": lambda row: row.scene,
            "F_z [N]": _each(lambda press: press.force_n[2]),
            "by the reference [N]": lambda row: _by(references, row, lambda p: p.force_n[2]),
            "its preset": lambda row: _by(references, row, lambda p: p.preset),
            "off by [%]": lambda row: _percent(error(row)),
            "raw off by [%]": lambda row: _percent(raw(row)),
            "stated [%]": _each(stated),
            "sideways off by [%]": sideways,
            "balance": _each(lambda press: f"{press.balance:.0e}"),
        },
        passed=allowed is None
        or all(
            off is not None and abs(off) <= allowed.of(references[row.scene].press.force_n[2])
            for off, row in zip(errors, rows, strict=True)
        ),
        **_prose(
            "forces",
            way=rows[0].manner.text,
            allowed=text,
            unknown=[row.scene for row in rows if row.scene not in references],
        ),
    )


def _launches(rows: Sequence[SceneRow]) -> Table:
    found = [(row.scene, row.press.parts_s) for row in rows if row.press]
    names = dict.fromkeys(name for _, parts in found for name in parts)

    def time_us(row: tuple[str, dict[str, float]], name: str) -> Cell:
        return round(1e6 * row[1][name], 1) if name in row[1] else None

    return table_of(
        found,
        {
            "scene": lambda row: row[0],
            **{f"{name} [us]": partial(time_us, name=name) for name in names},
        },
        **_prose("launches", way=rows[0].manner.text),
    )


def _work(rows: Sequence[SceneRow]) -> Table:
    return table_of(
        rows,
        {
            "scene": lambda row: row.scene,
            "tetrahedra": _each(lambda press: press.tet_count),
            "unknowns": _each(lambda press: press.unknown_count),
            "iterations": _each(lambda press: press.iterations),
            "set-up [s]": _each(lambda press: press.setup_s),
        },
        **_prose("work", way=rows[0].manner.text),
    )


def _each(value: Callable[[ScenePress], Cell]) -> Callable[[SceneRow], Cell]:
    """Return what shows a value of a row's press; nothing where there is none."""
    return lambda row: None if row.press is None else value(row.press)


def _counted(speed: float) -> Cell:
    return round(speed) if speed >= _WHOLE else f"{speed:.3g}"


def _percent(share: float | None) -> Cell:
    return None if share is None else f"{1e2 * share:+.2f}"


def _by(
    references: Mapping[str, Reference], row: SceneRow, value: Callable[[ScenePress], Cell]
) -> Cell:
    known = references.get(row.scene)
    return None if known is None else value(known.press)


_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY)
# Of a bar, of a scene at least, and of the axis with its labels and the legend [inch].
_BAR_IN, _SCENE_IN, _LABELS_IN = 0.1, 0.16, 1.0


def draw_scenes(
    groups: Sequence[Sequence[SceneRow]], folder: Path, *, page_folder: Path | None = None
) -> list[Path]:
    """Draw frames a second on a logarithmic axis and write ``scenes``; nothing without rows.

    Raises:
        RecordError: The files cannot be written.
    """
    groups = [rows for rows in groups if any(row.press for row in rows)]
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
                label=rows[0].manner.text,
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
        return save_figure(figure, folder, "scenes", page_folder=page_folder)
