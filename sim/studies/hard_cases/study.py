"""The hard cases: what a solver may break on, each with a criterion and what was measured."""

import operator
from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import Any

from sim.studies import from_file, measured_at
from sim.studies.hard_cases.small_pads import Measured, numbers_of
from tacauchy_rig.core.study import Case, Result, Study
from tacauchy_rig.core.tables import Table
from tacauchy_rig.core.versions import machine, versions

# By number what each case is called, what measures it, what has to hold, and how long it may take.
CASES = from_file("hard_cases/criteria.toml")
# What the numbers depend on.
_NUMERICAL = ("tacauchy-rig", "python", "warp-lang", "numpy", "scipy", "pypardiso")


class HardCases(Study):
    """Every case in a process of its own: if one raises, hangs or crashes, it has failed."""

    name, title, kind = "hard_cases", "Hard cases", "hard case"
    page_file = Path("docs/results/hard_cases.md")
    template = "page.md.jinja"

    def cases(self) -> Sequence[Case]:
        """Return every case, with what ``criteria.toml`` asks of it."""
        return [
            Case(
                name=case["name"],
                alias=number,
                shows=case["criterion"],
                measure=partial(measured, number),
                limit_s=case["limit_s"],
                is_isolated=True,
            )
            for number, case in CASES.items()
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
            "case_count": len(CASES),
            "versions": ", ".join(f"{name} {used[name]}" for name in _NUMERICAL if name in used),
            "machine": machine(),
        }


def _row(result: Result) -> dict[str, Any]:
    """Return a case as its JSON; one without numbers has failed."""
    numbers = {case["name"]: int(number) for number, case in CASES.items()}
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


def measured(number: str) -> dict[str, Any]:
    """Measure a case, or take the table of another study; return its numbers, and if it passed."""
    found = measured_at(CASES[number]["measure"])
    if isinstance(found, Table):
        return {"passed": found.passed, "measured": numbers_of(found)}
    return {"passed": has_passed(number, found), "measured": found}


def has_passed(number: str, found: Measured) -> bool:
    """Return whether what was measured is within all limits of a case."""
    return all(_is_within(limit, found) for limit in CASES[number]["limits"])


_SIGNS = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}


def _is_within(limit: str, found: Measured) -> bool:
    """Return whether all numbers of a pattern are within a limit, such as ``gap_* > 0``.

    On its right side may stand the name of another number. Of names none may be missing.
    """
    pattern, sign, bound = limit.rsplit(maxsplit=2)
    most = found[bound] if bound in found else float(bound)
    numbers = [value for name, value in found.items() if fnmatchcase(name, pattern)]
    return bool(numbers) and all(_SIGNS[sign](value, most) for value in numbers)
