"""The simulator against solutions and measurements that it did not make."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

from sim.studies import from_file, measured_at
from tacauchy_rig.core.markdown_page import prose, table_prose
from tacauchy_rig.core.study import About, Case, Result, Study, failures_table, founds
from tacauchy_rig.core.tables import Cell, Table, read_table, table_of_rows

Row = dict[str, Cell]
_TEMPLATE = "sim.studies.verification", "tables.md.jinja"


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
    command = f"tacauchy-rig press {press}" if press else ""
    about = table_prose(*_TEMPLATE, block, **facts)
    return table_of_rows(rows, passed=passed, command=command, **about)


class Verification(Study):
    """The simulator against solutions and measurements that it did not make."""

    name, title, kind = "verification", "Verification of the simulator", "section"

    def cases(self) -> Sequence[Case]:
        """Return every section."""
        stated = from_file("verification/presses.toml")
        return [
            Case(
                name=name, measure=partial(measure, place), on_request=name in stated["on_request"]
            )
            for name, place in stated["sections"].items()
        ]

    def line(self, result: Result) -> str:
        """Return how a section went."""
        return read_table(result.found).result

    def tables(self, results: Sequence[Result]) -> list[Table]:
        """Return the sections."""
        return [*map(read_table, founds(results)), *failures_table(results, kind=self.kind)]

    def facts(self, results: Sequence[Result]) -> Mapping[str, Any]:
        """Return the sections by name."""
        return {"sections": {each.name: each.found for each in results}}

    def note(self, results: Sequence[Result]) -> str:
        """Return where the numbers come from."""
        has_commands = any(table.command for table in self.tables(results))
        return prose(*_TEMPLATE, "note", has_commands=has_commands)

    def page(self, results: Sequence[Result], about: About, images: Sequence[str]) -> str:
        """Return the page; that of one section has its title."""
        text = super().page(results, about, images)
        tables = self.tables(results)
        return text.replace(f"# {self.title}", f"# {tables[0].title}", 1 if len(tables) == 1 else 0)


def measure(place: str) -> dict[str, Any]:
    """Measure a section, ``module:function`` of this package; return its table."""
    return asdict(measured_at(f"verification.{place}"))
