"""Tables of others: a CSV, its rows as presses, and the images that they name."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np
from pydantic import ValidationError

from tacauchy_rig.app.importing.presses import (
    ORDER_NS,
    Frame,
    Press,
    Recorded,
    Samples,
    Window,
)
from tacauchy_rig.app.importing.source import IMAGE_BYTES, TABLE_BYTES, Source
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.config.fields import Force, Section
from tacauchy_rig.core.errors import ConfigError, RecordError
from tacauchy_rig.core.quantities import UNITS, Dimension
from tacauchy_rig.core.run import FZ

ROWS_MOST = 2_000_000
"""A kilohertz for half an hour."""
COLUMNS_MOST = 1000


T = TypeVar("T", bound=Section)
_LINES_MOST = 40  # of a message: what one may mend before looking again
_VALUE_MOST = 120  # characters of a value in a message


def read_section(kind: type[T], tables: Any, *, where: str = "") -> T:
    """Return a table of ``import.toml`` as what it is to be.

    Args:
        kind: Of the table.
        tables: As it was written.
        where: Its name, with a dot; for messages.

    Raises:
        ConfigError: One line for each field that is wrong.
    """
    try:
        return kind.model_validate(tables)
    except ValidationError as error:
        lines = [f"{where}{_line(problem, kind)}" for problem in error.errors()[:_LINES_MOST]]
        raise ConfigError(
            "\n".join(lines), remedy="docs/reference/file-formats.md shows each format"
        ) from error


def _line(problem: Any, kind: type[Section]) -> str:
    """Return what is wrong with a field, in one line."""
    name = ".".join(str(part) for part in problem["loc"])
    if problem["type"] == "missing":
        return f"{name}: missing"
    if problem["type"] == "extra_forbidden" and len(problem["loc"]) == 1:
        return f"{name}: unknown key; known here: {', '.join(kind.model_fields)}"
    if problem["type"] == "extra_forbidden":
        return f"{name}: unknown key"
    value = json.dumps(problem["input"], ensure_ascii=False, default=str)[:_VALUE_MOST]
    return f"{name}: {value}: {problem['msg'].removeprefix('Value error, ')}"


class Column(Section):
    """A column with numbers: its name, and the unit of what stands in it."""

    column: str
    unit: str

    def factor(self, dimension: Dimension, *, field: str) -> float:
        """Return what its numbers are multiplied by to be SI; refuses as ``unit_factor``."""
        return unit_factor(self.unit, dimension, field=f"{field}.unit")


def unit_factor(unit: str, dimension: Dimension, *, field: str) -> float:
    """Return what numbers in a unit are multiplied by to be SI.

    Raises:
        ConfigError: The unit is not of the dimension.
    """
    units = UNITS[dimension]
    if unit not in units:
        raise ConfigError(
            f'{field}: "{unit}" is no unit of a {dimension.value}',
            remedy=f"one of: {', '.join(each for each in units if each)}",
        )
    return units[unit]


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A CSV with a head line.

    Attributes:
        name: Of its file, for messages.
        columns: Where each column stands in a row.
        rows: Of text, all as long as the head.
    """

    name: str
    columns: Mapping[str, int]
    rows: Sequence[Sequence[str]]

    def text(self, column: str, *, field: str) -> list[str]:
        """Return a column's cells, blanks at their ends taken off.

        Raises:
            RecordError: There is no such column.
        """
        if column not in self.columns:
            raise RecordError(
                f'{field}: {self.name} has no column "{column}"',
                remedy=f"its columns: {', '.join(self.columns)}",
            )
        place = self.columns[column]
        return [row[place].strip() for row in self.rows]

    def numbers(self, column: Column | None, dimension: Dimension, *, field: str) -> list[float]:
        """Return a column in SI; NaN in an empty cell, and all of them without a column.

        Raises:
            RecordError: There is no such column, or a cell holds no finite number.
            ConfigError: The unit is not of the dimension.
        """
        if column is None:
            return [math.nan] * len(self.rows)
        factor = column.factor(dimension, field=field)
        cells = self.text(column.column, field=field)
        return [
            factor * self._number(cell, line, column) if cell else math.nan
            for line, cell in enumerate(cells, start=2)
        ]

    def _number(self, cell: str, line: int, column: Column) -> float:
        try:
            value = float(cell)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise RecordError(
                f'{self.name} line {line}, column "{column.column}": {cell[:40]!r} is no finite '
                f"number of {column.unit}",
                remedy="write a decimal point and no unit; leave the cell empty if nobody knows",
            )
        return value


def read_table(source: Source, name: str, *, field: str) -> Table:
    """Read a CSV with a head line, separated by commas, in UTF-8.

    Raises:
        RecordError: It is not that, or too long.
    """
    data = source.read(name, field=field, most_bytes=TABLE_BYTES)
    try:
        lines = list(csv.reader(io.StringIO(data.decode("utf-8-sig"), newline=""), strict=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise RecordError(
            f"{name}: no CSV in UTF-8: {error}", remedy="save it as CSV with commas, UTF-8"
        ) from error
    head, rows = [cell.strip() for cell in lines[0]] if lines else [], lines[1:]
    rows = [row for row in rows if any(cell.strip() for cell in row)]
    if not rows or not any(head):
        raise RecordError(f"{name}: has no row below its head line", remedy="look at the file")
    if len(rows) > ROWS_MOST or len(head) > COLUMNS_MOST:
        raise RecordError(
            f"{name}: {len(rows)} rows of {len(head)} columns; at most {ROWS_MOST} and "
            f"{COLUMNS_MOST} are read",
            remedy="split it",
        )
    twice = {cell for cell in head if cell and head.count(cell) > 1}
    if twice:
        raise RecordError(
            f"{name}: the column {', '.join(sorted(twice))} stands twice in its head line",
            remedy="rename one of them",
        )
    for line, row in enumerate(rows, start=2):
        if len(row) != len(head):
            raise RecordError(
                f"{name} line {line}: {len(row)} cells, the head line has {len(head)}",
                remedy="a comma in a number or a line that was cut off: mend that line",
            )
    return Table(name=name, columns={cell: k for k, cell in enumerate(head)}, rows=rows)


Image = Callable[[str, str], Callable[[], bytes]]
"""Returns what reads an image, from its name and the field that names it; whether it is there is
asked at once."""

UNLOADED, PRESSED = "unloaded", "pressed"
WRENCH = ("force_x", "force_y", "force", "moment_x", "moment_y", "moment_z")
POSE = ("x", "y", "z")
_DIMENSIONS = {"force": Dimension.FORCE, "moment": Dimension.TORQUE, "time": Dimension.TIME}
"""By the first word of a column's name; all others are lengths."""


class SampleColumns(Section):
    """Which columns hold forces, moments and the tip's position, and in which unit.

    Attributes:
        force: Along the sensor's axis; the others of the wrench as they are known.
        x: Of the tip relative to the pad's centre.
        z: Of the tip, upwards.
    """

    force: Column | None = None
    force_x: Column | None = None
    force_y: Column | None = None
    moment_x: Column | None = None
    moment_y: Column | None = None
    moment_z: Column | None = None
    x: Column | None = None
    y: Column | None = None
    z: Column | None = None


def read_columns(table: Table, columns: SampleColumns, *names: str) -> FloatArray:
    """Return columns by their role in SI, shape [n, names]; NaN where nothing is known."""
    values = [
        table.numbers(
            getattr(columns, name),
            _DIMENSIONS.get(name.partition("_")[0], Dimension.LENGTH),
            field=f"data.columns.{name}",
        )
        for name in names
    ]
    return np.array(values).T


class Columns(SampleColumns):
    """Which column holds what.

    Attributes:
        image: File of the row's image, within ``images``.
        press: Name of the press that a row belongs to; without, each row is a press.
        state: ``unloaded`` or ``pressed``; anything else is neither. Without, every row is pressed.
        depth: Below first touch.
        indenter: As ``press --indenter`` has it.
    """

    image: str
    press: str | None = None
    state: str | None = None
    indenter: str | None = None
    time: Column | None = None
    depth: Column | None = None
    contact_z: Column | None = None


class RowsData(Section):
    """``[data]`` of every kind of table.

    Attributes:
        no_contact: Image of the gel at rest, for presses without an unloaded row.
        is_tared: Forces are zero without contact: unloaded rows define no zero.
        contact_force: At which depth counts from; left out, depth counts from first touch.
    """

    columns: Columns
    no_contact: str | None = None
    is_tared: bool = False
    contact_force: Force | None = None


class CsvData(RowsData):
    """``[data]`` of a folder with a CSV.

    Attributes:
        table: The CSV.
        images: Folder of the images.
    """

    table: str = "presses.csv"
    images: str = "."


def read_csv_folder(source: Source, data: CsvData) -> Recorded:
    """Read a folder of images with a CSV.

    Raises:
        RecordError: A file is missing or odd; names it with line and column.
        ConfigError: A unit is not of what it is to measure.
    """
    table = read_table(source, data.table, field="data.table")
    images = source.folder(data.images, field="data.images").relative_to(source.root)
    prefix = "" if str(images) == "." else f"{images}/"
    return presses_of(table, data, image=image_files(source, prefix), at_rest=image_files(source))


def image_files(source: Source, prefix: str = "") -> Image:
    """Return what finds images that are files, below a folder."""

    def image(name: str, field: str) -> Callable[[], bytes]:
        source.path(prefix + name, field=field, most_bytes=IMAGE_BYTES)
        return partial(source.read, prefix + name, field=field, most_bytes=IMAGE_BYTES)

    return image


def presses_of(table: Table, data: RowsData, *, image: Image, at_rest: Image) -> Recorded:
    """Return the presses that a table's rows hold.

    Args:
        image: Of a row.
        at_rest: Of ``no_contact``.

    Raises:
        RecordError: A row is odd; names it with line and column.
        ConfigError: A unit is not of what it is to measure.
    """
    rows = _Rows(table, data.columns)
    presses = (
        _press(data, rows, np.flatnonzero(rows.press == name), image=image, at_rest=at_rest)
        for name in dict.fromkeys(rows.press.tolist())
    )
    has_clock = data.columns.time is not None
    return Recorded(
        presses=tuple(presses),
        has_clock=has_clock,
        contact_force_n=data.contact_force,
        unknown=tuple(_unknown(data.columns, data)),
        notes=() if has_clock else ("Stamps of this run count rows; no time was stated.",),
    )


def _unknown(columns: Columns, data: RowsData) -> list[str]:
    has_zero = columns.force is None or data.is_tared or columns.state is not None
    lacks = {
        "What ties force and image of a row together in time": True,
        "The force": columns.force is None,
        "The zero of the force cell": not has_zero,
        "The depth": columns.depth is None and columns.z is None,
        "Where on the pad was pressed": columns.x is None or columns.y is None,
        "How the indenter leans": columns.moment_x is None,
    }
    return [f"{what} is not known." for what, is_lacking in lacks.items() if is_lacking]


class _Rows:
    """A table as arrays of one length."""

    def __init__(self, table: Table, columns: Columns) -> None:
        def text(column: str | None, name: str, otherwise: list[str]) -> np.ndarray:
            cells = table.text(column, field=f"data.columns.{name}") if column else otherwise
            return np.array(cells, dtype=object)

        count = len(table.rows)
        self.table = table.name
        self.stamp_ns = ORDER_NS * np.arange(1, count + 1)
        if columns.time is not None:
            self.stamp_ns = _stamps(read_columns(table, columns, "time")[:, 0], table.name)
        self.press = text(columns.press, "press", [str(k) for k in range(1, count + 1)])
        self.state = text(columns.state, "state", [PRESSED] * count)
        self.image = text(columns.image, "image", [])
        self.indenter = text(columns.indenter, "indenter", [""] * count)
        self.wrench = read_columns(table, columns, *WRENCH)
        self.place = read_columns(table, columns, *POSE)
        self.depth, self.contact_z = read_columns(table, columns, "depth", "contact_z").T

    def window(self, own: np.ndarray) -> Window | None:
        """Return first and last stamp of some rows; None of none."""
        stamps = self.stamp_ns[own]
        return (int(stamps.min()), int(stamps.max())) if len(own) else None

    def samples(self, own: np.ndarray, values: FloatArray) -> Samples | None:
        """Return the values of some rows as a stream; None of none."""
        return Samples(stamp_ns=self.stamp_ns[own], value=values[own]) if len(own) else None


def _stamps(time_s: FloatArray, name: str) -> np.ndarray:
    """Return times as stamps that begin a second after zero."""
    if np.isnan(time_s).any():
        line = int(np.flatnonzero(np.isnan(time_s))[0]) + 2
        raise RecordError(f"{name} line {line}: has no time", remedy="every row needs one")
    return np.asarray(np.rint((time_s - time_s.min() + 1.0) * 1e9), dtype=np.int64)


def _press(data: RowsData, rows: _Rows, own: np.ndarray, *, image: Image, at_rest: Image) -> Press:
    name = rows.press[own[0]]
    own = own[np.argsort(rows.stamp_ns[own], kind="stable")]
    unloaded, pressed = own[rows.state[own] == UNLOADED], own[rows.state[own] == PRESSED]
    if not len(pressed):
        raise RecordError(
            f'{rows.table}: press {name} has no row whose state is "{PRESSED}"',
            remedy=f'write "{UNLOADED}" and "{PRESSED}" into the column of data.columns.state',
        )
    frames = [
        Frame(
            stamp_ns=int(rows.stamp_ns[k]),
            name=rows.image[k],
            read=image(rows.image[k], f"press {name}, image"),
        )
        for k in own
        if rows.image[k]
    ]
    reference = rows.window(unloaded[rows.image[unloaded] != ""])
    if reference is None and data.no_contact is not None:
        stamp = int(rows.stamp_ns[own[0]]) - ORDER_NS
        rest = at_rest(data.no_contact, "data.no_contact")
        frames.insert(0, Frame(stamp_ns=stamp, name=data.no_contact, read=rest))
        reference = (stamp, stamp)
    if reference is None:
        raise RecordError(
            f"{rows.table}: press {name} has no image of the gel at rest",
            remedy=f'name one as data.no_contact, or add rows whose state is "{UNLOADED}"',
        )
    has_force = np.asarray(~np.isnan(rows.wrench[:, FZ]))
    has_place = np.asarray(~np.isnan(rows.place).any(axis=1))
    pose = np.pad(rows.place, ((0, 0), (0, 3)), constant_values=math.nan)
    x, y, _ = _mean(rows.place[pressed])
    return Press(
        name=name,
        frames=tuple(frames),
        reference=reference,
        dwell=rows.window(pressed) or (0, 0),
        force=rows.samples(own[has_force[own]], rows.wrench),
        pose=rows.samples(own[has_place[own]], pose),
        tare=None if data.is_tared else rows.window(unloaded[has_force[unloaded]]),
        contact_z_m=_known(_mean(rows.contact_z[own])),
        depth_m=_known(_mean(rows.depth[pressed])),
        place_m=None if math.isnan(x) or math.isnan(y) else (float(x), float(y)),
        indenter=next((rows.indenter[k] for k in pressed if rows.indenter[k]), ""),
    )


def _known(value: FloatArray) -> float | None:
    return None if math.isnan(value) else float(value)


def _mean(values: FloatArray) -> FloatArray:
    """Return the mean over rows of what is known; NaN where nothing is."""
    known = ~np.isnan(values)
    total = np.where(known, values, 0.0).sum(axis=0)
    return np.asarray(np.where(known.any(axis=0), total / np.maximum(known.sum(axis=0), 1), np.nan))
