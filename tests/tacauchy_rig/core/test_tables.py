"""Tables on pages and terminals, pages of Markdown, and cases chosen by patterns."""

import io

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.markdown_page import criteria_page, filled, table_prose
from tacauchy_rig.core.study import selected
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


MET = Table(
    title="Punch",
    columns=("nu", "error [%]", "tets"),
    rows=((0.45, 0.70049, 3090), (0.499, None, 12345)),
    criterion="within 1.5 %",
    passed=True,
    note="a note",
    command="tacauchy-rig press --depth 0.05mm",
)
MISSED = Table(title="Disc", columns=("a",), rows=(("x",),), criterion="within 1 %", passed=False)
REPORTED = Table(title="Cost", columns=(), rows=(), criterion="none: it is a time", passed=True)


def made(*tables: Table, note: str = "") -> str:
    """Return a page of tables."""
    return criteria_page(tables, title="Checks", note=note, command="tacauchy-rig verify")


def test_page_shows_numbers_to_four_digits_and_counts_whole() -> None:
    """Floats are rounded, integers are not, None is empty."""
    text = made(MET)
    assert "| 0.45 | 0.7005 | 3090 |" in text
    assert "| 0.499 |  | 12345 |" in text
    assert "**2 sections, every criterion is met.**" in made(MET, MET)
    assert "```\ntacauchy-rig press --depth 0.05mm\n```" in text


def test_page_counts_what_was_missed() -> None:
    """A missed criterion stands in the first lines and in the summary."""
    text = made(MET, MISSED)
    assert "**2 sections, 1 of them missed.**" in text
    assert "| Disc | **missed** | within 1 % |" in text


def test_page_of_one_section_speaks_of_one() -> None:
    """One section has one criterion."""
    assert "**1 section: met.**" in made(MET)
    assert "**1 section: missed.**" in made(MISSED)
    assert "**1 section: reported.**" in made(REPORTED)


def test_page_does_not_call_met_what_nothing_was_demanded_of() -> None:
    """A section without a criterion is reported."""
    assert "| Cost | reported |" in made(REPORTED)


def test_paragraphs_are_filled_and_tables_left_as_they_are() -> None:
    """Prose is broken at 100 characters; a table's row, a list's line and code are not."""
    long = " ".join(["word"] * 60)
    text = made(MET, note=long)
    assert all(len(line) <= 100 for line in text.splitlines() if "word" in line)
    kept = f"| {long} |\n\n- {long}\n\n```\n{long}\n```\n"
    assert filled(kept) == kept
    assert "\n\n\n" not in text


def test_a_block_of_a_template_is_one_line_of_prose() -> None:
    """A table's note is filled by whoever shows it, so that it holds no line breaks."""
    facts = {"seed": 7, "wanted": 90.0, "tolerance": 0.01}
    found = table_prose("sim.studies.bench", "tables.md.jinja", "alone", **facts)
    note = found["note"]
    assert found["title"] == "A batch's forces against presses alone"
    assert found["criterion"].endswith("every press is found and 90% of F_z are within 5%")
    assert note.startswith("Balls and rounded punches drawn with seed 7 as above")
    assert "\n" not in note
    assert "  " not in note


TREES = ("ash", "elm", "oak", "holm oak")


def chosen(*patterns: str) -> tuple[str, ...]:
    """Trees by name, or by its first letter."""
    return selected(TREES, patterns, names=lambda tree: (tree, tree[0]), kind="tree")


def test_patterns_choose_in_the_items_order() -> None:
    """Any name will do, what two patterns name is there once, and no pattern is all."""
    assert chosen("*oak", "a", "ash") == ("ash", "oak", "holm oak")
    assert chosen() == TREES


def test_a_pattern_that_matches_nothing_is_refused() -> None:
    """A misspelt one is not left out, not even beside one that matches; what there is is told."""
    with pytest.raises(ConfigError, match="--only 'oka': no such tree") as refused:
        chosen("ash", "oka")
    assert "choose among ash; elm; oak; holm oak" in refused.value.remedy
