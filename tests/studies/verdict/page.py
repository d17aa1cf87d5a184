"""What was found, as a page."""

from __future__ import annotations

from collections.abc import Sequence

from reports.comparison.criteria import headline_of
from reports.comparison.results import ValidationReport
from tacauchy_rig.core.page import page
from tacauchy_rig.core.tables import Cell, Table, table_of
from tests.studies.verdict.check import MEASURED_UNCERTAINTY, Finding, missed_of
from tests.studies.verdict.wrong_models import STEPS_TO_DOUBLE

_MEASURED = f"{100.0 * MEASURED_UNCERTAINTY:g} %"


def true_table(reports: Sequence[tuple[str, ValidationReport]]) -> Table:
    """Return how the true model stands in each run: the worst trial of each criterion."""
    rows: list[tuple[Cell, ...]] = []
    names: dict[str, str] = {}
    for _, report in reports:
        names |= {r.name: r.unit for r in headline_of(report.trials, report.criteria)}
    for label, report in reports:
        worst = {r.name: r.worst for r in headline_of(report.trials, report.criteria)}
        missed = _words(missed_of(report)) or "none"
        rows.append((label, *(worst.get(name) for name in names), missed))
    headings = [f"{n.replace('_', ' ')}{f' [{u}]' if u else ''}" for n, u in names.items()]
    return Table(
        title="The true model",
        columns=("run", *headings, "missed"),
        rows=tuple(rows),
        criterion="nothing is missed",
        passed=all(report.passed for _, report in reports),
    )


def wrong_table(findings: Sequence[Finding], *, uncertainty: str) -> Table:
    """Return what was caught, by what, and from which size on.

    Args:
        uncertainty: Of the modulus in the sensor's file, in words.
    """
    return table_of(
        findings,
        {
            "wrong model": lambda f: f.model.name,
            "size": lambda f: _sized(f, f.model.size),
            "caught by": lambda f: _words(f.own.missed) or "not caught",
            "caught from": lambda f: _sized(f, f.caught_from()),
            "by": _by,
            "largest that passes": lambda f: _sized(f, f.passes_at),
            f"caught from, modulus known to {_MEASURED}": lambda f: _sized(
                f, f.caught_from(measured=True)
            ),
            "what hides less": lambda f: f.model.hides.format(uncertainty=uncertainty),
            "sizes looked at": lambda f: len(f.looks),
            "time [s]": lambda f: round(sum(look.seconds for look in f.looks.values())),
        },
        title="Wrong models",
        criterion="each is caught, or the smallest size that is caught is named",
        passed=all(found.caught for found in findings),
    )


def check_page(true: Table, wrong: Table, *, command: str, preset: str, version: str) -> str:
    """Return the page."""
    facts = {
        "true_model": true,
        "wrong_models": wrong,
        "command": command,
        "preset": preset,
        "measured": _MEASURED,
        "step": f"{2.0 ** (1.0 / STEPS_TO_DOUBLE):.3g}",
        "version": version,
    }
    return page("tests.studies.verdict", "verdict_check.md.jinja", facts)


def _by(found: Finding) -> str:
    """Return what catches the smallest size that is caught."""
    smallest = found.caught_from()
    return "" if not found.model.size or smallest is None else _words(found.looks[smallest].missed)


def _sized(found: Finding, size: float | None) -> str:
    """Return a size; nothing for a model that has none, for which it is caught or not."""
    if not found.model.size:
        return ""
    return "none" if size is None else f"{size:.3g} {found.model.unit}"


def _words(names: Sequence[str]) -> str:
    return ", ".join(name.replace("_", " ") for name in names)
