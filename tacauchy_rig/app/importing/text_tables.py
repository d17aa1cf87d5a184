"""Tables of others as text: separator, decimal sign, units and times, and where each cell stands.

Read with ``csv`` of the standard library: it takes no time to start and keeps every cell with its
line, where readers that guess types (pandas, Polars, pyarrow, DuckDB; 12 to 170 MB) tell one bad
cell at most, and its Sniffer takes the comma of ``1,5`` for a separator.
"""

import csv
import io
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Literal

import numpy as np

from tacauchy_rig.app.importing.source_files import TABLE_BYTES, Problems, Source, at_most, shown
from tacauchy_rig.core.arrays import BoolArray, FloatArray
from tacauchy_rig.core.config.field_ranges import Section
from tacauchy_rig.core.errors import ConfigError, RecordError, whole
from tacauchy_rig.core.quantities import UNITS, Dimension

ROWS_MOST = 2_000_000
"""A kilohertz for half an hour."""
COLUMNS_MOST = 1000
SEPARATORS = "\t;|,"
"""In this order: whoever writes decimal commas separates by another sign."""
LOOKED_AT = 50
"""Lines that tell the separator."""
ISO = "iso"
"""Unit of times as ISO 8601 writes them; a unit with ``%`` is a format of ``strptime``."""
UNKNOWN = {"", "nan", "na", "n/a", "none", "null", "#n/a", "-"}
"""Cells of values that nobody knows."""
MOST = {Dimension.FORCE: 1e5, Dimension.TORQUE: 1e4, Dimension.LENGTH: 100.0}
"""SI; no press of a gel has more."""
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_POINT_ONLY = re.compile(r"[0-9eE+\-. \t\x1f]*")
_BLANKS = str.maketrans("\u2212", "-", "\u00a0\u202f\u2009 '")
_COMMA = re.compile(r"[+-]?(\d{1,3}(\.\d{3})+|\d*),\d+([eE][+-]?\d+)?")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")
FORMATS = "docs/reference/file-formats.md shows each format"
"""Remedy of a description that is wrong."""


class Column(Section):
    """A column with numbers: its name, their unit, and -1 where they count the other way."""

    column: str
    unit: str
    sign: Literal[1, -1] = 1

    def factor(self, dimension: Dimension, *, field: str) -> float:
        """Return what its numbers are multiplied by to be SI; refuses as ``unit_factor``."""
        return self.sign * unit_factor(self.unit, dimension, field=f"{field}.unit")


class Dialect(Section):
    """How a table is written; what is left out is found."""

    separator: str | None = None
    decimal: Literal[".", ","] | None = None


def unit_factor(unit: str, dimension: Dimension, *, field: str) -> float:
    """Return what numbers in a unit are multiplied by to be SI.

    Raises:
        ConfigError: The unit is not of the dimension.
    """
    units = UNITS[dimension]
    if unit in units:
        return units[unit]
    listed = f"one of: {', '.join(each for each in units if each)}"
    if dimension is Dimension.FORCE and unit in UNITS[Dimension.MASS]:
        listed = f'write "{unit}f" if the balance or cell shows gram-force; else {listed}'
    if dimension is Dimension.TIME:
        listed += f', "{ISO}", or a format such as "%d.%m.%Y %H:%M:%S.%f"'
    raise ConfigError(f'{field}: "{unit}" is no unit of a {dimension.value}', remedy=listed)


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Rows of text below a head line."""

    name: str  # of its file, for messages
    columns: Mapping[str, int]  # where each column stands in a row
    rows: Sequence[Sequence[str]]  # of text, all as long as the head
    places: Sequence[int | str]  # of each row, for messages: the line, or the record's name
    separator: str = ","
    decimal: str | None = None  # sign of decimals; None: what each column shows
    # Takes what is wrong; reading goes on with unknown values
    problems: Problems = field(default_factory=Problems)

    def where(self, row: int, column: str = "") -> str:
        """Return where a cell stands."""
        place = self.places[row]
        line = f"{self.name} line {place}" if isinstance(place, int) else place
        return f'{line}, column "{column}"' if column else line

    def cells(self, column: str) -> list[str]:
        """Return a column's cells, blanks at their ends taken off."""
        place = self.columns[column]
        return [row[place].strip() for row in self.rows]

    def text(self, column: str, *, field: str) -> list[str]:
        """Return a column's cells; empty ones, and a problem, where there is no such column."""
        if column in self.columns:
            return self.cells(column)
        self.problems.add(
            f'{field}: {self.name} has no column "{column}"',
            remedy=f"its columns: {', '.join(self.columns)}",
        )
        return [""] * len(self.rows)

    def numbers(self, column: Column | None, dimension: Dimension, *, field: str) -> FloatArray:
        """Return a column in SI; NaN where nothing is known, and where a cell is no number."""
        if column is None:
            return np.full(len(self.rows), np.nan)
        cells = self.text(column.column, field=field)

        def known(values: FloatArray, wrong: BoolArray, what: str, remedy: str) -> FloatArray:
            """Return NaN for values that are wrong; their cells are told unless they say so."""
            told = [
                f"{self.where(k, column.column)}: {cells[k][:40]!r} {what}"
                for k in np.flatnonzero(wrong).tolist()
                if cells[k].lower() not in UNKNOWN
            ]
            if told:
                self.problems.add(shown(told), remedy=remedy)
            return np.where(wrong, np.nan, values)

        if dimension is Dimension.TIME and (column.unit == ISO or "%" in column.unit):
            remedy = f'"{ISO}" is such as 2026-11-27T10:00:00.250; else a format such as '
            remedy += '"%d.%m.%Y %H:%M:%S.%f"'
            times = np.array([instant(cell, column.unit) for cell in cells])
            return known(times, np.isnan(times), "is no time of the stated form", remedy)
        factor = math.nan
        with self.problems.noting():
            factor = column.factor(dimension, field=field)
        remedy = "write plain numbers without a unit; leave the cell empty if nobody knows"
        values = self._plain(cells, column)
        what = f"is no finite number of {column.unit}"
        values = factor * known(values, ~np.isfinite(values), what, remedy)
        is_large = np.abs(values) > MOST.get(dimension, math.inf)
        remedy = f"correct the value, or {field}.unit"
        return known(values, is_large, "more than any press of a gel has", remedy)

    def _plain(self, cells: Sequence[str], column: Column) -> FloatArray:
        """Return cells as numbers, those with decimal commas too; NaN where one is none."""
        if self.decimal != "," and _POINT_ONLY.fullmatch("\x1f".join(cells)):
            with suppress(ValueError):
                return np.array([cell or "nan" for cell in cells], dtype=np.float64)
        comma = self._has_commas(cells, column)
        return np.array([_number(cell, comma=comma) for cell in cells])

    def _has_commas(self, cells: Sequence[str], column: Column) -> bool:
        """Return whether a column's decimals follow a comma."""
        if self.decimal is not None:
            return self.decimal == ","
        plain = [cell.translate(_BLANKS) for cell in cells]
        found = [cell for cell in plain if _COMMA.fullmatch(cell)]
        if not found or not all(_THOUSANDS.fullmatch(cell) for cell in found):
            return bool(found)
        with_point = any("." in cell for cell in plain)
        if not with_point:
            self.problems.add(
                f'{self.name}, column "{column.column}": {found[0]!r} may be a decimal comma '
                "or one of thousands",
                remedy='state it: data.decimal = "," or "."',
            )
        return not with_point


def _number(cell: str, *, comma: bool) -> float:
    """Return a cell's number; NaN where it is none, or has another sign of decimals."""
    plain = cell.translate(_BLANKS)
    if not comma:
        whole, point, rest = plain.partition(".")
        if _THOUSANDS.fullmatch(whole):
            plain = f"{whole.replace(',', '')}{point}{rest}"
    elif _COMMA.fullmatch(plain):
        plain = plain.replace(".", "").replace(",", ".")
    elif "." in plain:
        return math.nan
    return float(plain) if _NUMBER.fullmatch(plain) else math.nan


def instant(cell: str, unit: str) -> float:
    """Return a date and time [s]; one without a zone counts as UTC."""
    try:
        found = datetime.fromisoformat(cell) if unit == ISO else datetime.strptime(cell, unit)
    except ValueError:
        return math.nan
    return (found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp()


def read_table(source: Source, name: str, *, field: str, dialect: Dialect | None = None) -> Table:
    """Read a table with a head line; rows that are too short or too long are told and left out.

    Raises:
        RecordError: It is no text, has no rows, or is too long.
    """
    dialect = dialect or Dialect()
    text = _decoded(source.read(name, field=field, most_bytes=TABLE_BYTES), name)
    separator, text = _separator_of(text, stated=dialect.separator)
    with whole(name, "table", remedy="look for a quotation mark that does not end"):
        (_, head), *found = _cells(text, separator) or [(0, [""])]
    head = [cell.strip() for cell in head]
    _check_size(name, head, len(found))
    rows, places, odd = [], [], []
    for line, cells in found:
        if len(cells) >= len(head) and not any(cell.strip() for cell in cells[len(head) :]):
            rows.append(cells)
            places.append(line)
        else:
            odd.append(f"{name} line {line}: {len(cells)} cells, the head line has {len(head)}")
    if odd:
        sign = {" ": "blank", "\t": "tab"}.get(separator, separator)
        source.problems.add(
            shown(odd),
            remedy=f"cells are separated by {sign!r}: mend these lines, or state data.separator",
        )
    return Table(
        name=name,
        columns={cell: k for k, cell in enumerate(head)},
        rows=rows,
        places=places,
        separator=separator,
        decimal=dialect.decimal,
        problems=source.problems,
    )


def _check_size(name: str, head: Sequence[str], count: int) -> None:
    if not count or not any(head):
        raise RecordError(f"{name} has no row below its head line", remedy="add a row a press")
    at_most(ROWS_MOST, count, f"{name}: {count} rows")
    at_most(COLUMNS_MOST, len(head), f"{name}: {len(head)} columns")
    twice = {cell for cell in head if cell and head.count(cell) > 1}
    if twice:
        raise RecordError(
            f"{name}: the column {', '.join(sorted(twice))} stands twice in its first line",
            remedy="rename one of them",
        )


def _decoded(data: bytes, name: str) -> str:
    """Return a table's text, of UTF-8, UTF-16 with its mark, or a Western European code page.

    Raises:
        RecordError: It is none of them.
    """
    marked = data[:2] in (b"\xff\xfe", b"\xfe\xff")
    for code in ("utf-16",) if marked else ("utf-8-sig", "cp1252"):
        try:
            text = data.decode(code)
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text
    raise RecordError(
        f"{name}: no CSV in UTF-8, UTF-16 or Windows-1252",
        remedy="save it as CSV in UTF-8; of a spreadsheet save one sheet as CSV",
    )


def _separator_of(text: str, *, stated: str | None) -> tuple[str, str]:
    """Return the separator of a table's cells, and its text without a line that states it.

    It is the first sign that parts all lines alike; blanks, where no sign does.
    """
    first, _, rest = text.partition("\n")
    if found := re.fullmatch(r"sep=(.)\s*", first):
        return found[1], f"\n{rest}"
    if stated:
        return stated, text
    lines = [line for line in text.splitlines()[: 4 * LOOKED_AT] if line.strip()][:LOOKED_AT]
    shares = {}
    for sign in SEPARATORS:
        counts = [len(row) for row in csv.reader(lines, delimiter=sign) if row]
        if counts and counts[0] > 1:
            shares[sign] = counts.count(counts[0]) / len(counts)
    if shares:
        return max(shares, key=lambda sign: shares[sign]), text
    words = {len(line.split()) for line in lines}
    return (" " if len(words) == 1 and words != {1} else ","), text


def _cells(text: str, separator: str) -> list[tuple[int, list[str]]]:
    """Return the rows that hold something, each with its line."""
    if separator == " ":
        split = enumerate(map(str.split, text.splitlines()), start=1)
        return [(line, cells) for line, cells in split if cells]
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
    rows, before = [], 0
    for cells in reader:
        if any(cell.strip() for cell in cells):
            rows.append((before + 1, cells))
        before = reader.line_num
    return rows


def as_csv(rows: Iterable[Iterable[object]]) -> bytes:
    """Return rows as CSV; what is not known is empty."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()


def toml_value(value: object) -> str:
    """Return a value as TOML: a string, number or list is in it what it is in JSON."""
    if isinstance(value, Mapping):
        pairs = (f"{key} = {toml_value(each)}" for key, each in value.items())
        return f"{{ {', '.join(pairs)} }}"
    return json.dumps(value, ensure_ascii=False)


def as_toml(values: Mapping[str, object]) -> str:
    """Return keys and values as lines of TOML."""
    return "".join(f"{key} = {toml_value(each)}\n" for key, each in values.items())
