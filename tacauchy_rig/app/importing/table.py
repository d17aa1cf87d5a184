"""A CSV as rows of text, and its columns as numbers in SI; odd ones are refused by name."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from tacauchy_rig.app.importing.source import TABLE_BYTES, Source
from tacauchy_rig.app.importing.spec import Column
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.quantities import Dimension

ROWS_MOST = 2_000_000
"""A kilohertz for half an hour."""
COLUMNS_MOST = 1000


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
