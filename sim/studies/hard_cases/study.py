"""The hard cases: what a solver may break on, each with a criterion and what was measured."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from importlib import resources
from pathlib import Path
from typing import Any

from sim.studies.hard_cases import dynamics, invariants, materials, meshes, precision
from sim.studies.hard_cases.pads import Outcome
from tacauchy_rig.core.study import Case, Result, Study
from tacauchy_rig.core.tables import Table
from tacauchy_rig.core.versions import machine, versions

MEASURES: dict[str, Callable[[], Outcome]] = {
    "1": invariants.degenerate_starts,
    "2": invariants.random_start,
    "3": materials.nearly_incompressible,
    "4": materials.deep_presses,
    "5": meshes.moved_rim,
    "6": dynamics.time_steps,
    "7": materials.slivers,
    "8": materials.stiff_layers,
    "9": dynamics.stick_slip,
    "10": dynamics.impact,
    "11": dynamics.torsion,
    "12": invariants.scaled_units,
    "13": precision.single_precision,
    "14": invariants.no_contact,
    "15": invariants.penetrating_start,
    "16": meshes.off_the_pad,
    "17": meshes.consistency_and_order,
    "18": invariants.force_balance,
    "19": invariants.repeatable,
}
# What the numbers depend on.
_NUMERICAL = ("tacauchy-rig", "python", "warp-lang", "numpy", "scipy", "pypardiso")


@cache
def _stated() -> dict[str, dict[str, Any]]:
    """Return by number what each case is called, what has to hold, and how long it may take."""
    text = resources.files("sim.studies.hard_cases").joinpath("criteria.toml").read_text()
    return tomllib.loads(text)


class HardCases(Study):
    """Every case in a process of its own: if one raises, hangs or crashes, it has failed."""

    name, title, kind = "hard_cases", "Hard cases", "hard case"
    page_file = Path("docs/results/hard_cases.md")
    template = "page.md.jinja"

    def cases(self) -> Sequence[Case]:
        """Return every case, with what ``criteria.toml`` asks of it."""
        return [
            Case(
                name=_stated()[number]["name"],
                alias=number,
                shows=_stated()[number]["criterion"],
                measure=partial(_measured, measure),
                limit_s=_stated()[number]["limit_s"],
                is_isolated=True,
            )
            for number, measure in MEASURES.items()
        ]

    def line(self, result: Result) -> str:
        """Return the verdict, and what it took."""
        return f"{_verdict(_row(result))} after {result.wall_s:.1f} s"

    def tables(self, results: Sequence[Result]) -> list[Table]:
        """Return for each case what was measured, a line a number, or why nothing was."""
        return [
            Table(
                title=f"{row['number']}. {row['name']}: {_verdict(row)}",
                columns=("measured", ""),
                rows=(("No numbers", row["failure"]),)
                if row["failure"]
                else tuple(row["measured"].items()),
                criterion=row["criterion"],
                passed=row["passed"],
            )
            for row in map(_row, results)
        ]

    def facts(self, results: Sequence[Result]) -> Mapping[str, Any]:
        """Return the cases by number and name."""
        return {"cases": list(map(_row, results))}

    def page_facts(self, results: Sequence[Result]) -> Mapping[str, Any]:
        """Return the cases, each with its table, and what their numbers depend on."""
        rows, used = list(map(_row, results)), versions()
        return {
            "results": list(zip(rows, self.tables(results), strict=True)),
            "failed": [row["number"] for row in rows if not row["passed"]],
            "case_count": len(MEASURES),
            "versions": ", ".join(f"{name} {used[name]}" for name in _NUMERICAL if name in used),
            "machine": machine(),
        }


def _row(result: Result) -> dict[str, Any]:
    """Return a case as its JSON; one without numbers has failed."""
    numbers = {stated["name"]: int(number) for number, stated in _stated().items()}
    return {
        "number": numbers[result.name],
        "name": result.name,
        "criterion": result.shows,
        **(result.found or {"passed": False, "measured": {}}),
        "wall_s": result.wall_s,
        "failure": result.failure,
    }


def _verdict(row: Mapping[str, Any]) -> str:
    return "pass" if row["passed"] else "FAIL"


def _measured(measure: Callable[[], Outcome]) -> dict[str, Any]:
    return measure()._asdict()
