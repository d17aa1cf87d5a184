"""A section of a page, as a table on the terminal."""

from __future__ import annotations

from rich.table import Table
from rich.text import Text

from sim.studies.verification.page import cell, result
from sim.studies.verification.section import Section
from tacauchy_rig.cli.output import console


def result_word(section: Section) -> str:
    """Return a section's result without Markdown."""
    return result(section).strip("*")


def show_section(section: Section) -> None:
    """Print a section's table and how it went."""
    table = Table(title=section.title, title_justify="left", caption_justify="left")
    for number, column in enumerate(section.columns):
        table.add_column(column, justify="right" if number else "left", overflow="fold")
    for row in section.rows:
        table.add_row(*(Text(cell(value)) for value in row))
    table.caption = f"{result_word(section)}: {section.criterion}"
    console.print(table)
