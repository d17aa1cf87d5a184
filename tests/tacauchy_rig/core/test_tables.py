"""Tables on pages and on terminals."""

from __future__ import annotations

import io

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from tacauchy_rig.core.tables import Table, markdown_table, table_of, terminal_table

WIDE = Table(
    title="A wide table",
    columns=("engine", *(f"quantity number {k} of them all [mm]" for k in range(16))),
    rows=(("tacauchy_rig, a quarter, quadratic", *(k * 1.23456e-7 for k in range(16))),),
    criterion="every number is the one that was asked for, " * 3,
)


def shown(table: Table, width: int) -> list[str]:
    """Return what a terminal shows, soft wrapping as the command line does."""
    file = io.StringIO()
    Console(file=file, width=width, soft_wrap=True).print(terminal_table(table, width=width))
    return file.getvalue().splitlines()


@pytest.mark.parametrize("width", [60, 80, 132])
def test_a_wide_table_fits_the_terminal_with_every_number_whole(width: int) -> None:
    """Its columns are parted, no line is too long, and each part repeats the first column."""
    lines = shown(WIDE, width)
    assert max(map(len, lines)) <= width
    text = "\n".join(lines)
    assert all(f"{k * 1.23456e-7:.4g}" in text for k in range(16))
    assert text.count("engine") > 1
    assert "met: every number" in text


def test_no_cell_takes_five_lines() -> None:
    """A long text is given the width for that."""
    text = "the base reaction and the indenter's force are alike to a millionth of their size; " * 2
    lines = shown(Table(columns=("row", "criterion", "s"), rows=((1, text, 2.0),)), 80)
    assert len([line for line in lines if line.strip()]) <= 2 + 4


def test_a_table_is_made_of_records_by_heading() -> None:
    """A count stays whole, a truth is yes or no, what is not known is empty."""
    table = table_of(
        [1.23456, 7.0],
        {"x [m]": lambda x: x, "count": int, "over 2": lambda x: x > 2.0, "none": lambda _: None},
    )
    assert markdown_table(table).splitlines() == [
        "| x [m] | count | over 2 | none |",
        "|---|---|---|---|",
        "| 1.235 | 1 | no |  |",
        "| 7 | 7 | yes |  |",
    ]


def test_a_bar_in_a_cell_does_not_end_it() -> None:
    """Nor does a line break end the row."""
    table = Table(columns=("a",), rows=(("x | y\nz",),))
    assert markdown_table(table).splitlines()[-1] == r"| x \| y z |"


def test_a_long_first_column_leaves_room_for_the_others() -> None:
    """It takes as many lines as it needs; a path beside it stays whole."""
    text = " ".join(["a" * 20] * 12)
    rows = ((text, "x" * 30, "y"), ("short", "w" * 30 + " " + "u" * 12, "z"))
    assert_whole(Table(columns=("a", "b", "c"), rows=rows))


_WORDS = st.text("abcdefgh", min_size=1, max_size=24)
_CELLS = st.lists(_WORDS, max_size=40).map(" ".join)


@given(
    rows=st.integers(1, 6).flatmap(
        lambda width: st.lists(
            st.lists(_CELLS, min_size=width, max_size=width).map(tuple), min_size=2, max_size=4
        )
    )
)
def test_no_word_of_any_table_is_broken_at_80(rows: list[tuple[str, ...]]) -> None:
    """Whatever stands in the first column and beside it."""
    assert_whole(Table(columns=rows[0], rows=tuple(rows[1:])))


def assert_whole(table: Table) -> None:
    """Compare the words of a table with those that a terminal of 80 columns shows of it."""
    lines = shown(table, 80)
    assert max(map(len, lines)) <= 80
    texts = [text for row in ((table.title, *table.columns), *table.rows) for text in row]
    wanted = {word for text in texts for word in str(text).replace("**", "").split()}
    found = {word.rstrip(":") for word in " ".join(lines).split()}
    assert {word.rstrip(":") for word in wanted if len(word) <= 60} <= found


def test_what_every_row_says_is_said_once() -> None:
    """A text of several words above the table, not in a column; a single row keeps its own."""
    gpu = "NVIDIA H100 80GB HBM3"
    rows = tuple((gpu, count, "fast") for count in (1, 60))
    table = Table(columns=("device", "environments", "preset"), rows=rows)
    lines = shown(table, 80)
    assert [line for line in lines if gpu in line] == [f"device: {gpu}"]
    assert sum("fast" in line for line in lines) == 2
    alone = shown(Table(columns=table.columns, rows=rows[:1]), 80)
    assert f"device: {gpu}" not in alone
