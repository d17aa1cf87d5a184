"""The verification as Markdown."""

from __future__ import annotations

from sim.studies.verification.page import markdown
from sim.studies.verification.section import Section

MET = Section(
    title="Punch",
    columns=("nu", "error [%]", "tets"),
    rows=((0.45, 0.70049, 3090), (0.499, None, 12345)),
    criterion="within 1.5 %",
    passed=True,
    note="a note",
    command="tacauchy-rig press --depth 0.05mm",
)
MISSED = Section(title="Disc", columns=("a",), rows=(("x",),), criterion="within 1 %", passed=False)
REPORTED = Section(title="Cost", columns=(), rows=(), criterion="none: it is a time", passed=True)


def page(*sections: Section) -> str:
    """Return a page of sections."""
    return markdown(
        sections, command="tacauchy-rig verify", versions={"numpy": "2"}, machine="Linux"
    )


def test_page_shows_numbers_to_four_digits_and_counts_whole() -> None:
    """Floats are rounded, integers are not, None is empty."""
    text = page(MET)
    assert "| 0.45 | 0.7005 | 3090 |" in text
    assert "| 0.499 |  | 12345 |" in text
    assert "**2 sections, every criterion is met.**" in page(MET, MET)
    assert "```\ntacauchy-rig press --depth 0.05mm\n```" in text


def test_page_counts_what_was_missed() -> None:
    """A missed criterion stands in the first lines and in the summary."""
    text = page(MET, MISSED)
    assert "**2 sections, 1 of them missed.**" in text
    assert "| Disc | **missed** | within 1 % |" in text


def test_page_of_one_section_speaks_of_one() -> None:
    """One section has one criterion, and without a command none is promised below its table."""
    assert "**1 section: met.**" in page(MET)
    assert "**1 section: missed.**" in page(MISSED)
    assert "**1 section: reported.**" in page(REPORTED)
    assert "command below a table" in " ".join(page(MET).split())
    assert "command below a table" not in " ".join(page(MISSED).split())


def test_page_does_not_call_met_what_nothing_was_demanded_of() -> None:
    """A section without a criterion is reported."""
    assert "| Cost | reported |" in page(REPORTED)
