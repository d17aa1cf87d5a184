"""The simulator against solutions and measurements that it did not make."""

from collections.abc import Mapping, Sequence
from importlib import resources

from tacauchy_rig.core.page import table_prose
from tacauchy_rig.core.tables import Cell, Table, table_of_rows

Row = dict[str, Cell]


def section(
    block: str,
    rows: Sequence[Mapping[str, Cell]],
    /,
    *,
    passed: bool = True,
    press: str = "",
    **facts: object,
) -> Table:
    """Return a section's table; ``block`` says title, criterion and note.

    Args:
        press: Options of ``tacauchy-rig press`` that give one of the rows.
        facts: Values that the template shows.
    """
    prose = table_prose("sim.studies.verification", "tables.md.jinja", block, **facts)
    command = f"tacauchy-rig press {press}" if press else ""
    return table_of_rows(rows, passed=passed, command=command, **prose)


def reference_text(file: str) -> str:
    """Return the text of a file of references."""
    return resources.files("sim.studies.verification.data").joinpath(file).read_text("utf-8")
