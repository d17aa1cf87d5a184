"""A table of what was measured: for a page, for a terminal and as JSON, from one description."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table as RichTable
from rich.text import Text

# Counts are int and shown whole, other numbers to four digits; None where there is nothing to say.
Cell = str | float | None
Record = TypeVar("Record")

# The most lines of one cell or heading on a terminal.
_LINES = 4
# What rich puts around a column: padding of one on both sides, and one between columns.
_GAP = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """What was measured, beside its criterion; its fields are its JSON.

    Attributes:
        columns: Headings, each with its unit in brackets.
        rows: Cells in the order of ``columns``.
        criterion: What has to hold, in words; begins with ``none`` where nothing is demanded, and
            is empty where a table has no criterion of its own.
        passed: It held; true where nothing was demanded.
        note: What a reader has to know to judge the numbers.
        command: A ``tacauchy-rig`` command that gives one of the rows; empty where none does.
    """

    title: str = ""
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    criterion: str = ""
    passed: bool = True
    note: str = ""
    command: str = ""

    @property
    def result(self) -> str:
        """How it went, in a word."""
        if self.criterion.startswith("none"):
            return "reported"
        return "met" if self.passed else "missed"

    @property
    def texts(self) -> list[list[str]]:
        """The cells as they are shown."""
        return [[cell_text(cell) for cell in row] for row in self.rows]


def table_of(
    records: Iterable[Record],
    columns: Mapping[str, Callable[[Record], Cell]],
    *,
    title: str = "",
    criterion: str = "",
    passed: bool = True,
    note: str = "",
    command: str = "",
) -> Table:
    """Return a table with a row for each record.

    Args:
        columns: By heading, what a record shows there.
        title: This and the rest as in ``Table``.
    """
    return Table(
        title=title,
        columns=tuple(columns),
        rows=tuple(tuple(value(record) for value in columns.values()) for record in records),
        criterion=criterion,
        passed=passed,
        note=note,
        command=command,
    )


def cell_text(cell: Cell) -> str:
    """Return a cell as text: numbers to four digits, but counts whole; yes or no; None empty."""
    if cell is None:
        return ""
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    return f"{cell:.4g}" if isinstance(cell, float) else str(cell)


def markdown_table(table: Table) -> str:
    """Return the rows as a table of Markdown, without title and note."""
    lines = [table.columns, *table.texts]
    shown = ["| " + " | ".join(_escaped(text) for text in line) + " |" for line in lines]
    shown.insert(1, "|" + "---|" * len(table.columns))
    return "\n".join(shown)


def _escaped(text: str) -> str:
    return text.replace("|", r"\|").replace("\n", " ")


def terminal_table(table: Table, *, width: int) -> RenderableType:
    """Return a table for a terminal, with its title and how it went.

    Where the columns need more than the width they are parted, and the first is repeated.

    Args:
        width: Of the terminal, in characters.
    """
    shown: list[RenderableType] = [Text(line) for line in textwrap.wrap(table.title, width)]
    texts = [[text.replace("**", "") for text in row] for row in table.texts]
    cells = [[heading, *(row[k] for row in texts)] for k, heading in enumerate(table.columns)]
    for columns in _parted([_Column.of(each, width) for each in cells], width):
        drawn = RichTable(box=box.SIMPLE_HEAD, pad_edge=False)
        for number, column in enumerate(columns):
            drawn.add_column(
                Text(column.cells[0]),
                justify="right" if number and column.is_short else "left",
                overflow="fold",
                width=column.width,
            )
        for row in zip(*(column.cells[1:] for column in columns), strict=True):
            drawn.add_row(*(Text(text) for text in row))
        shown.append(drawn)
    if table.criterion:
        shown += [Text(each) for each in textwrap.wrap(f"{table.result}: {table.criterion}", width)]
    return Group(*shown)


@dataclass(frozen=True, slots=True)
class _Column:
    """A column on a terminal: heading and cells, and the width that they are given."""

    cells: list[str]
    width: int

    @classmethod
    def of(cls, cells: list[str], width: int) -> _Column:
        """Make a column just wide enough for its cells to wrap in few lines."""
        return cls(cells, max(_narrowest(text, width) for text in cells))

    @property
    def is_short(self) -> bool:
        """Its cells are numbers or words, which a reader compares by their ends."""
        return all(" " not in text for text in self.cells[1:])

    def widened(self, spare: int) -> _Column:
        """Return it as wide as its text, or by what is to spare."""
        return _Column(self.cells, min(max(map(len, self.cells)), self.width + spare))


def _narrowest(text: str, most: int) -> int:
    """Return the least width at which a text has few lines and no broken word."""
    words = text.split() or [""]
    width = max(1, min(max(map(len, words)), most))
    while width < most and len(textwrap.wrap(text, width)) > _LINES:
        width += 1
    return width


def _parted(columns: Sequence[_Column], width: int) -> list[list[_Column]]:
    """Return groups of columns that fit the width, each beginning with the first column."""
    if not columns:
        return []
    first, *rest = columns
    groups: list[list[_Column]] = [[first]]
    for column in rest:
        if len(groups[-1]) > 1 and _width([*groups[-1], column]) > width:
            groups.append([first])
        groups[-1].append(column)
    return [_spread(group, width) for group in groups]


def _width(columns: Sequence[_Column]) -> int:
    return sum(column.width + _GAP for column in columns)


def _spread(columns: list[_Column], width: int) -> list[_Column]:
    """Give what is left of the width to the columns that still wrap, from the left."""
    for k, column in enumerate(columns):
        columns[k] = column.widened(max(width - _width(columns), 0))
    return columns
