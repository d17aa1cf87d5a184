"""The benchmark's scenes as tables."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

from sim.error.tolerance import parse_tolerance
from sim.studies.bench.scenes.own_process import IMAGES, NOT_YET, Order, SceneRow
from sim.studies.bench.scenes.press import FRAME_COUNT, ScenePress
from sim.studies.bench.scenes.references import Reference
from sim.studies.bench.scenes.suite import SceneBench, mean_speed, speeds
from tacauchy_rig.core.page import table_prose
from tacauchy_rig.core.tables import Cell, Table, table_of

# Frames a second that are wanted at 5 %, mean and least: by kind of device, environments, manner.
_WANTED: dict[tuple[bool, int | None, tuple[str, ...]], tuple[float, float]] = {
    (True, None, ()): (40.0, 10.0),
    (False, None, ()): (300.0, 300.0),
    (False, 1, ()): (300.0, 300.0),
    (False, 60, ()): (10_000.0, 10_000.0),
    (False, 60, (IMAGES,)): (5_550.0, 5_550.0),
}
_JUDGED = "5%"
# From here on frames a second are shown as whole numbers.
_WHOLE = 100.0
_prose = partial(table_prose, "sim.studies.bench.scenes", "scenes.md.jinja")


def scene_tables(found: SceneBench) -> list[Table]:
    """Return the tables of what was measured, in the order of the page."""
    return [table for rows in found.groups for table in _group(rows, found.references)]


def way(row: SceneRow | Order) -> str:
    """Say how the rows of a group are pressed."""
    many = {None: "alone", 1: "1 environment"}.get(
        row.environments, f"{row.environments} environments"
    )
    parts = [row.device, many]
    if row.tolerance and row.environments is None:
        parts.append(f"tolerance {row.tolerance}")
    return ", ".join([*parts, *row.manner])


def _group(rows: Sequence[SceneRow], references: dict[str, Reference]) -> Iterator[Table]:
    yield _speed(rows)
    yield _worth(rows, references)
    yield _work(rows)
    if any(row.press and row.press.parts_s for row in rows):
        yield _launches(rows)
    failed = [row for row in rows if row.failure and not row.failure.startswith(NOT_YET)]
    if failed:
        yield table_of(
            failed,
            {"scene": lambda row: row.scene, "why": lambda row: row.failure},
            passed=False,
            **_prose("failures", way=way(rows[0]), count=len(failed)),
        )


def _speed(rows: Sequence[SceneRow]) -> Table:
    first, found = rows[0], speeds(rows)
    is_cpu = first.device == "cpu"
    wanted = _WANTED.get((is_cpu, first.environments, first.manner))
    if first.environments is None and first.tolerance != _JUDGED:
        wanted = None
    mean, least = mean_speed(rows), min(found, default=0.0)
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
            way=way(first),
            wanted=wanted,
            mean=f"{mean:.1f}",
            least=f"{least:.1f}",
            measured=len(found),
            count=len(rows),
            frames=FRAME_COUNT,
            is_cpu=is_cpu,
        ),
    )


def _worth(rows: Sequence[SceneRow], references: dict[str, Reference]) -> Table:
    text = rows[0].tolerance if any(row.scene in references for row in rows) else ""
    allowed = parse_tolerance(text, field="--tolerance") if text else None

    def error(row: SceneRow) -> float | None:
        known = references.get(row.scene)
        return None if known is None or row.press is None else known.force_error(row.press)

    def sideways(row: SceneRow) -> Cell:
        known = references.get(row.scene)
        off = None if known is None or row.press is None else known.sideways_error(row.press)
        return _percent(off)

    errors = [error(row) for row in rows]
    return table_of(
        rows,
        {
            "scene": lambda row: row.scene,
            "F_z [N]": _each(lambda press: press.force_n[2]),
            "by the reference [N]": lambda row: _by(references, row, lambda p: p.force_n[2]),
            "its preset": lambda row: _by(references, row, lambda p: p.preset),
            "off by [%]": lambda row: _percent(error(row)),
            "sideways off by [%]": sideways,
            "balance": _each(lambda press: f"{press.balance:.0e}"),
        },
        passed=allowed is None
        or all(
            off is not None and abs(off) <= allowed.of(references[row.scene].press.force_n[2])
            for off, row in zip(errors, rows, strict=True)
        ),
        **_prose(
            "worth",
            way=way(rows[0]),
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
        **_prose("launches", way=way(rows[0])),
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
        **_prose("work", way=way(rows[0])),
    )


def _each(value: Callable[[ScenePress], Cell]) -> Callable[[SceneRow], Cell]:
    """Return what shows a value of a row's press; nothing where there is none."""
    return lambda row: None if row.press is None else value(row.press)


def _counted(speed: float) -> Cell:
    return round(speed) if speed >= _WHOLE else f"{speed:.3g}"


def _percent(share: float | None) -> Cell:
    return None if share is None else f"{1e2 * share:+.2f}"


def _by(
    references: dict[str, Reference], row: SceneRow, value: Callable[[ScenePress], Cell]
) -> Cell:
    known = references.get(row.scene)
    return None if known is None else value(known.press)
