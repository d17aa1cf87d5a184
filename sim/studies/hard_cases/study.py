"""The hard cases: what a solver may break on, each with a criterion and what was measured."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any

from sim.studies.hard_cases import (
    dynamics,
    invariants,
    materials,
    meshes,
    precision,
    sliding,
    starts,
)
from sim.studies.hard_cases.pads import Outcome
from tacauchy_rig.core.page import page
from tacauchy_rig.core.study import About, Case, Result, Study
from tacauchy_rig.core.tables import Table
from tacauchy_rig.core.versions import machine, versions

MEASURES: dict[str, Callable[[], Outcome]] = {
    "1": starts.degenerate_starts,
    "2": starts.random_start,
    "3": materials.nearly_incompressible,
    "4": materials.deep_presses,
    "5": meshes.moved_rim,
    "6": dynamics.time_steps,
    "7": materials.slivers,
    "8": materials.stiff_layers,
    "9": sliding.stick_slip,
    "10": dynamics.impact,
    "11": sliding.torsion,
    "12": invariants.scaled_units,
    "13": precision.single_precision,
    "14": invariants.no_contact,
    "15": starts.penetrating_start,
    "16": meshes.off_the_pad,
    "17": meshes.consistency_and_order,
    "18": invariants.force_balance,
    "19": invariants.repeatable,
}
# What the numbers depend on.
_NUMERICAL = ("tacauchy-rig", "python", "warp-lang", "numpy", "scipy", "pypardiso")


@dataclass(frozen=True, slots=True, kw_only=True)
class CaseRow:
    """A case that was measured; its fields are its JSON.

    Attributes:
        failure: Why there are no numbers: the error, or the time limit; empty otherwise.
    """

    number: int
    name: str
    criterion: str
    passed: bool
    measured: Mapping[str, Any]
    wall_s: float
    failure: str = ""

    @property
    def verdict(self) -> str:
        """``pass`` or ``FAIL``."""
        return "pass" if self.passed else "FAIL"

    @property
    def table(self) -> Table:
        """What was measured, one line for each number; why nothing was, where nothing was."""
        return Table(
            title=f"{self.number}. {self.name}: {self.verdict}",
            columns=("measured", ""),
            rows=(("No numbers", self.failure),) if self.failure else tuple(self.measured.items()),
            criterion=self.criterion,
            passed=self.passed,
        )


class HardCases(Study):
    """Every case in a process of its own: if one raises, hangs or crashes, it has failed."""

    name, title, kind = "hard_cases", "Hard cases", "hard case"
    page_file = Path("docs/results/hard_cases.md")

    def cases(self) -> Sequence[Case]:
        """Return every case, with what ``criteria.toml`` asks of it."""
        text = resources.files("sim.studies.hard_cases").joinpath("criteria.toml").read_text()
        stated = tomllib.loads(text)
        return [
            Case(
                name=stated[number]["name"],
                alias=number,
                shows=stated[number]["criterion"],
                measure=partial(_measured, measure),
                limit_s=stated[number]["limit_s"],
                is_isolated=True,
            )
            for number, measure in MEASURES.items()
        ]

    def line(self, result: Result) -> str:
        """Return the verdict, and what it took."""
        return f"{self.rows([result])[0].verdict} after {result.wall_s:.1f} s"

    def rows(self, results: Sequence[Result]) -> list[CaseRow]:
        """Return the cases as they are shown; one without numbers has failed."""
        numbers = {case.name: int(case.alias) for case in self.cases()}
        return [
            CaseRow(
                number=numbers[each.name],
                name=each.name,
                criterion=each.shows,
                wall_s=each.wall_s,
                failure=each.failure,
                **(each.found or {"passed": False, "measured": {}}),
            )
            for each in results
        ]

    def tables(self, results: Sequence[Result]) -> list[Table]:
        """Return a table for each case."""
        return [row.table for row in self.rows(results)]

    def facts(self, results: Sequence[Result]) -> Mapping[str, Any]:
        """Return the cases by number and name."""
        return {"cases": self.rows(results)}

    def page(self, results: Sequence[Result], about: About, images: Sequence[str]) -> str:
        """Return the page: the verdicts, then each case with its criterion and numbers."""
        del images
        used = versions()
        facts = {
            "results": self.rows(results),
            "failed": [row.number for row in self.rows(results) if not row.passed],
            "case_count": len(MEASURES),
            "command": about.command,
            "versions": ", ".join(f"{name} {used[name]}" for name in _NUMERICAL if name in used),
            "machine": machine(),
        }
        return page("sim.studies.hard_cases", "page.md.jinja", facts)


def _measured(measure: Callable[[], Outcome]) -> dict[str, Any]:
    return measure()._asdict()
