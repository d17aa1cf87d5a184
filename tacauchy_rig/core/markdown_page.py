"""Pages of Markdown: prose from a template, tables, and what was measured with its criteria."""

import re
import textwrap
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import TypedDict

from jinja2 import Environment, PackageLoader, StrictUndefined

from tacauchy_rig.core.tables import Table, markdown_cell, markdown_table
from tacauchy_rig.core.versions import machine, versions

_WIDTH = 100
# Tables, headings, figures and lists stand as they are written.
_UNFILLED = ("|", "#", "!", "- ", "```")


def page(package: str, template: str, facts: Mapping[str, object]) -> str:
    """Return a template's text as Markdown, its paragraphs filled to lines of 100 characters.

    Templates show a table by ``{{ t | table }}``, or write one with ``{{ c | cell }}``.
    They may split prose into lines as they like.

    Args:
        package: That the template lies in, such as ``tacauchy_rig.app.cli.studies``.
    """
    return filled(_environment(package).get_template(template).render(**facts))


def prose(package: str, template: str, block: str, /, **facts: object) -> str:
    """Return one block of a template as for ``page``, such as a table's note, as a single line."""
    return " ".join(_block(package, template, block, facts).split())


class TableProse(TypedDict):
    """What a table is called, what has to hold, and what a reader has to know."""

    title: str
    criterion: str
    note: str


def table_prose(package: str, template: str, block: str, /, **facts: object) -> TableProse:
    """Return title, criterion and note of a table: the paragraphs of a block as for ``prose``."""
    title, criterion, *notes = _paragraphs(_block(package, template, block, facts))
    return TableProse(title=title, criterion=criterion, note=" ".join(notes))


def _block(package: str, template: str, block: str, facts: dict[str, object]) -> str:
    found = _environment(package).get_template(template)
    return "".join(found.blocks[block](found.new_context(facts)))


def _paragraphs(text: str) -> tuple[str, ...]:
    parts = re.split(r"\n\s*\n", text)
    return tuple(" ".join(part.split()) for part in parts if part.strip())


def sentences(
    package: str,
    template: str,
    facts: Mapping[str, object],
    *,
    filters: Mapping[str, Callable[..., str]],
) -> tuple[str, ...]:
    """Return the paragraphs of a template, each as a single line.

    Package, template and facts are as for ``page``.

    Args:
        filters: What it may write a fact by, beside Jinja's own.
    """
    environment = _environment(package)
    environment.filters |= filters
    return _paragraphs(environment.get_template(template).render(**facts))


@cache
def _environment(package: str) -> Environment:
    """Return what reads a package's templates, and compiles each only once."""
    environment = environment_of(package, ".", is_html=False)
    environment.filters |= {"table": markdown_table, "cell": markdown_cell}
    return environment


def environment_of(package: str, folder: str = "templates", *, is_html: bool = True) -> Environment:
    """Return what reads templates in a folder of a package, as all pages here are written."""
    return Environment(
        loader=PackageLoader(package, folder),
        autoescape=is_html,  # noqa: S701 - Markdown is none
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def filled(text: str) -> str:
    """Return Markdown with one empty line between blocks and paragraphs in lines of 100.

    A blank line ends a block, in a fence of code too.
    """
    blocks = [block.strip("\n") for block in re.split(r"\n\s*\n", text)]
    return "\n\n".join(_filled(block) for block in blocks if block) + "\n"


def _filled(block: str) -> str:
    if block.startswith(_UNFILLED):
        return block
    return textwrap.fill(block, _WIDTH, break_long_words=False, break_on_hyphens=False)


def criteria_page(
    tables: Sequence[Table], *, title: str, note: str, command: str, images: Sequence[str] = ()
) -> str:
    """Return the page of a study: how it went, all criteria, then each table with its own.

    Args:
        note: What a reader has to know before all tables.
        images: Files of figures that stand before them, beside the page.
    """
    facts = {
        "tables": tables,
        "title": title,
        "note": note,
        "command": command,
        "versions": versions(),
        "machine": machine(),
        "images": images,
        "missed": sum(not table.passed for table in tables),
    }
    return page("tacauchy_rig.core", "criteria_page.md.jinja", facts)
