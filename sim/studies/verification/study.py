"""The verification: sections with known answers, each a table with its criterion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from importlib import import_module
from typing import Any

from tacauchy_rig.core.study import About, Case, Result, Study, failures_table, founds
from tacauchy_rig.core.tables import Table, read_table

SECTIONS = {
    "punch": "forces:measure_punch",
    "disc": "forces:measure_disc",
    "hertz": "forces:measure_ball",
    "pressure": "surface_fields:measure_pressure",
    "shear": "surface_fields:measure_shear",
    "real-press": "forces:measure_real",
    "orders": "forces:measure_orders",
    "rim-order": "forces:measure_rim",
    "half-element": "balance:measure_shift",
    "barrier": "balance:measure_barrier",
    "balance": "balance:measure",
    "interface": "balance:measure_interface",
    "drives": "balance:measure_drives",
    "height-map": "height_map:measure",
}
"""Where each section is measured, in the order of the page."""
ON_REQUEST = frozenset({"height-map"})
"""Sections with a page of their own."""


class Verification(Study):
    """The simulator against solutions and measurements that it did not make."""

    name, title, kind = "verification", "Verification of the simulator", "section"

    def cases(self) -> Sequence[Case]:
        """Return every section."""
        return [
            Case(name=name, measure=partial(measure, place), on_request=name in ON_REQUEST)
            for name, place in SECTIONS.items()
        ]

    def line(self, result: Result) -> str:
        """Return how a section went."""
        return result.failure or read_table(result.found).result

    def tables(self, results: Sequence[Result]) -> list[Table]:
        """Return the sections."""
        return [*map(read_table, founds(results)), *failures_table(results, kind=self.kind)]

    def facts(self, results: Sequence[Result]) -> Mapping[str, Any]:
        """Return the sections by name."""
        return {"sections": {each.name: each.found for each in results}}

    def note(self, results: Sequence[Result]) -> str:
        """Return where the numbers come from."""
        commands = "; the command below a table gives one of its rows"
        has_commands = any(table.command for table in self.tables(results))
        return (
            "Every number comes from the scenes, meshes and solver that `tacauchy-rig press` uses"
            f"{commands * has_commands}. Times apart, the numbers are the same when it is run "
            "again."
        )

    def page(self, results: Sequence[Result], about: About, images: Sequence[str]) -> str:
        """Return the page; that of one section has its title."""
        text = super().page(results, about, images)
        tables = self.tables(results)
        return text.replace(f"# {self.title}", f"# {tables[0].title}", 1 if len(tables) == 1 else 0)


def measure(place: str) -> dict[str, Any]:
    """Measure a section, ``module:function`` of this package; return its table."""
    module, _, name = place.partition(":")
    table: Table = getattr(import_module(f"sim.studies.verification.{module}"), name)()
    return asdict(table)
