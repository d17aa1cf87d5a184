"""The budget of presses whose indenters have sources of their own."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from reports.comparison.results import ValidationReport
from reports.page.writing import write_report


def without_a_term(report: ValidationReport, name: str) -> ValidationReport:
    """Return a report whose first press, of the smallest force, lacks a term of its budget."""
    first, *others = report.trials
    budget = tuple(term for term in first.force.budget if term.name != name)
    assert len(budget) == len(first.force.budget) - 1
    trials = (replace(first, force=replace(first.force, budget=budget)), *others)
    return replace(report, trials=trials)


@pytest.mark.usefixtures("undrawn")
def test_a_term_of_some_presses_stands_in_its_own_row(
    report: ValidationReport, tmp_path: Path
) -> None:
    """A ball has no fillet: what comes after it in a punch's budget is not taken for it."""
    last = report.trials[-1].force
    known = [term for term in last.budget if term.value_n]
    name, value_n = max(((term.name, term.value_n) for term in known), key=lambda t: t[1] or 0.0)
    lacking = without_a_term(report, name)
    assert value_n is not None
    assert last.combined is not None
    page = write_report(lacking, tmp_path).html.read_text("utf-8")
    (cells,) = re.findall(rf"<th>[a-z]+: {re.escape(name)}</th>(.*?)</tr>", page)
    assert cells.startswith("<td>&ndash;</td>")
    share = 100.0 * (value_n / last.combined.value_n) ** 2
    assert cells.endswith(f"<td>{share:.1f}</td>")
