"""Pages of Markdown."""

from __future__ import annotations

from tacauchy_rig.core.page import criteria_page, filled, table_prose
from tacauchy_rig.core.tables import Table

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
