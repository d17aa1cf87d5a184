"""What was found, as a page."""

from __future__ import annotations

from collections.abc import Sequence

from reports.comparison.headline import headline_of
from reports.comparison.results import ValidationReport
from tacauchy_rig.page import page
from tacauchy_rig.tables import Cell, Table
from tacauchy_rig.verdict_check.check import Finding, missed_of

_COLUMNS = (
    "wrong model",
    "size",
    "caught by",
    "smallest size caught",
    "by",
    "largest that passes",
    "what hides less",
)


def true_table(reports: Sequence[tuple[str, ValidationReport]]) -> Table:
    """Return how the true model stands in each run: the worst trial of each criterion."""
    rows: list[tuple[Cell, ...]] = []
    names: dict[str, str] = {}
    for _, report in reports:
        names |= {r.name: r.unit for r in headline_of(report.trials, report.criteria)}
    for label, report in reports:
        worst = {r.name: r.worst for r in headline_of(report.trials, report.criteria)}
        missed = ", ".join(_words(missed_of(report))) or "none"
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
    return Table(
        title="Wrong models",
        columns=_COLUMNS,
        rows=tuple(_row(found, uncertainty) for found in findings),
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
        "version": version,
    }
    return page("tacauchy_rig.verdict_check", "verdict_check.md.jinja", facts)


def _row(found: Finding, uncertainty: str) -> tuple[Cell, ...]:
    model = found.model
    return (
        model.name,
        _sized(model.size, model.unit),
        ", ".join(_words(found.caught_by)) or "not caught",
        "" if model.size is None else _sized(found.smallest, model.unit) or "none",
        ", ".join(_words(found.smallest_by)),
        _sized(found.passes_at, model.unit),
        model.hides.format(uncertainty=uncertainty),
    )


def _sized(size: float | None, unit: str) -> str:
    return "" if size is None else f"{size:.3g} {unit}"


def _words(names: Sequence[str]) -> list[str]:
    return [name.replace("_", " ") for name in names]
