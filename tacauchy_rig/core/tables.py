"""A table of what was measured: for a page, for a terminal and as JSON, from one description."""

import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any, TypedDict, TypeVar, Unpack

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
    """What was measured, beside its criterion; its fields are its JSON."""

    title: str = ""
    columns: tuple[str, ...]  # headings, each with its unit in brackets
    rows: tuple[tuple[Cell, ...], ...]  # cells in the order of ``columns``
    # What has to hold, in words; begins with ``none`` where nothing is demanded, and is empty where
    # a table has no criterion of its own
    criterion: str = ""
    passed: bool = True  # it held; true where nothing was demanded
    note: str = ""  # what a reader has to know to judge the numbers
    # A ``tacauchy-rig`` command that gives one of the rows; empty where none does
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


class About(TypedDict, total=False):
    """What a table says beside its rows, as in ``Table``."""

    title: str
    criterion: str
    passed: bool
    note: str
    command: str


def table_of(
    records: Iterable[Record],
    columns: Mapping[str, Callable[[Record], Cell]],
    **about: Unpack[About],
) -> Table:
    """Return a table with a row for each record.

    Args:
        columns: By heading, what a record shows there.
    """
    rows = tuple(tuple(value(record) for value in columns.values()) for record in records)
    return Table(columns=tuple(columns), rows=rows, **about)


def table_of_rows(rows: Sequence[Mapping[str, Cell]], **about: Unpack[About]) -> Table:
    """Return a table of cells by heading, those of the first row; there is at least one row."""
    return table_of(rows, {heading: itemgetter(heading) for heading in rows[0]}, **about)


def read_table(plain: Mapping[str, Any]) -> Table:
    """Return a table of its JSON."""
    rows = tuple(tuple(row) for row in plain["rows"])
    return Table(**{**plain, "columns": tuple(plain["columns"]), "rows": rows})


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
    shown = ["| " + " | ".join(map(markdown_cell, line)) + " |" for line in lines]
    shown.insert(1, "|" + "---|" * len(table.columns))
    return "\n".join(shown)


def markdown_cell(cell: Cell) -> str:
    """Return a cell's text so that it stays within its cell."""
    return cell_text(cell).replace("|", r"\|").replace("\n", " ")


def terminal_table(table: Table, *, width: int) -> RenderableType:
    """Return a table for a terminal, with its title and how it went.

    Where the columns need more than the width they are parted, and the first is repeated. A text of
    several words that every row has, such as a device, is said once above them.
    """
    texts = [[text.replace("**", "") for text in row] for row in table.texts]
    all_columns = [[heading, *(row[k] for row in texts)] for k, heading in enumerate(table.columns)]
    # In a constant column all of several rows have the same words.
    columns = [
        [heading, *cells]
        for heading, *cells in all_columns
        if len(cells) < 2 or len(set(cells)) > 1 or " " not in cells[0]
    ] or all_columns
    constants = [f"{column[0]}: {column[1]}" for column in all_columns if column not in columns]
    shown: list[RenderableType] = [
        Text(line) for text in (table.title, *constants) for line in textwrap.wrap(text, width)
    ]
    least = _least_widths(columns, width)
    for group in _parted(least, width):
        drawn = RichTable(box=box.SIMPLE_HEAD, pad_edge=False)
        # What is left of the width goes to the columns that still wrap, from the left.
        spare = max(width - _width([least[k] for k in group]), 0)
        for k in group:
            heading, *cells = columns[k]
            wide = min(max(map(len, columns[k])), least[k] + spare)
            spare -= max(wide - least[k], 0)
            # Numbers and words are compared by their ends.
            is_short = all(" " not in text for text in cells)
            drawn.add_column(
                Text(heading),
                justify="right" if k != group[0] and is_short else "left",
                overflow="fold",
                width=wide,
            )
        for row in range(1, len(texts) + 1):
            drawn.add_row(*(Text(columns[k][row]) for k in group))
        shown.append(drawn)
    if table.criterion:
        shown += [Text(each) for each in textwrap.wrap(f"{table.result}: {table.criterion}", width)]
    return Group(*shown)


def _least_widths(columns: Sequence[Sequence[str]], width: int) -> list[int]:
    """Return the widths at which cells have few lines, but beside the first every other fits."""
    least = [max(_narrowest(text, width) for text in column) for column in columns]
    unbroken = [
        max(len(word) for text in column for word in text.split() or [""]) for column in columns
    ]
    if len(columns) > 1:
        beside = width - 2 * _GAP
        least[0] = max(unbroken[0], min(least[0], beside - max(unbroken[1:])))
        least[1:] = [
            max(whole, min(wide, beside - least[0]))
            for whole, wide in zip(unbroken[1:], least[1:], strict=True)
        ]
    return least


def _narrowest(text: str, most: int) -> int:
    """Return the least width at which a text has few lines and no broken word."""
    words = text.split() or [""]
    width = max(1, min(max(map(len, words)), most))
    while width < most and len(textwrap.wrap(text, width)) > _LINES:
        width += 1
    return width


def _parted(widths: Sequence[int], width: int) -> list[list[int]]:
    """Return groups of columns that fit the width, each beginning with the first column."""
    groups = [[0]] if widths else []
    for k in range(1, len(widths)):
        if len(groups[-1]) > 1 and _width([widths[i] for i in (*groups[-1], k)]) > width:
            groups.append([0])
        groups[-1].append(k)
    return groups


def _width(columns: Sequence[int]) -> int:
    return sum(columns) + _GAP * len(columns)
