"""Two runs number by number, and one quantity over many runs as a chart."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from tacauchy_rig.app.gel_health.comparison import COVERAGE, Change
from tacauchy_rig.app.results.runs import Judged, ListedRun, criteria_of

# What a report says of all trials of a run: title, its place in the summary, factor and unit.
_OF_ALL = (
    ("SSIM", ("metrics", "ssim"), 1.0, ""),
    ("SSIM without contact", ("no_contact", "ssim"), 1.0, ""),
    ("NCC", ("metrics", "ncc"), 1.0, ""),
    ("NCC without contact", ("no_contact", "ncc"), 1.0, ""),
    ("PSNR", ("metrics", "psnr_db"), 1.0, "dB"),
    ("unexplained of the contact", ("contact_relative_residual",), 100.0, "%"),
    ("predicted force off by", ("prediction_error_relative",), 100.0, "%"),
)
_ROOM = 1.4
"""Of the limit, shown beyond it and beyond what was found."""
Value = tuple[float, float | None] | None
"""A number and its standard deviation; None where it is not known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """A number of both runs."""

    title: str
    unit: str
    one: Value
    other: Value

    @property
    def difference(self) -> float | None:
        """The other's value less the one's."""
        return None if self.one is None or self.other is None else self.other[0] - self.one[0]

    @property
    def spreads(self) -> float | None:
        """The difference over the deviations of both; None where neither is known."""
        if self.difference is None or self.one is None or self.other is None:
            return None
        both = math.hypot(*(each or 0.0 for each in (self.one[1], self.other[1])))
        return self.difference / both if both > 0.0 else None


def compare(one: ListedRun, other: ListedRun) -> list[Row]:
    """Return the numbers of two runs' reports, row by row."""
    summaries = one.summary, other.summary
    models = [summary.get("model") for summary in summaries]
    modulus = "modulus_factor", "modulus_factor_deviation"
    rows = [_row("modulus, of the stated one", "", models, *modulus)]
    for title, place, factor, unit in _OF_ALL:
        found = [_at(summary, "statistics", *place) for summary in summaries]
        rows.append(_row(title, unit, found, "mean", "deviation", factor))
    trials = [_trials(summary) for summary in summaries]
    for index in sorted(set(trials[0]) & set(trials[1])):
        both = [of_run[index] for of_run in trials]
        force = "force_measured_n", "force_deviation_n"
        rows.append(_row(f"force of trial {index}", "N", both, *force))
        rows.append(_row(f"depth of trial {index}", "mm", both, "depth_measured_m", "", 1e3))
    return [row for row in rows if row.one is not None or row.other is not None]


def _row(
    title: str, unit: str, places: Sequence[Any], name: str, deviation: str, factor: float = 1.0
) -> Row:
    """Return a number of two places in summaries, by its name and that of its deviation."""
    values: list[Value] = []
    for place in places:
        value, spread = _at(place, name), _at(place, deviation)
        known_spread = factor * spread if isinstance(spread, (int, float)) else None
        is_known = isinstance(value, (int, float))
        values.append((factor * value, known_spread) if is_known else None)
    return Row(title=title, unit=unit, one=values[0], other=values[1])


def _at(place: Any, *names: str) -> Any:
    """Return what lies at a path in nested tables; None where they are no tables."""
    for name in names:
        place = place.get(name) if isinstance(place, dict) else None
    return place


def _trials(summary: dict[str, Any]) -> dict[int, dict[str, Any]]:
    found = summary.get("trials")
    trials = found if isinstance(found, list) else []
    return {trial["index"]: trial for trial in trials if isinstance(_at(trial, "index"), int)}


def differing(one: ListedRun, other: ListedRun) -> list[tuple[str, str, str]]:
    """Return the criteria that one run met and the other did not: name, and both outcomes."""
    outcomes = _outcomes(one.summary), _outcomes(other.summary)
    names = list(dict.fromkeys([*outcomes[0], *outcomes[1]]))
    rows = [(name, outcomes[0].get(name), outcomes[1].get(name)) for name in names]
    return [
        (name.replace("_", " "), _in_words(a), _in_words(b))
        for name, a, b in rows
        if (a is not None and a[0] == a[1]) != (b is not None and b[0] == b[1])
    ]


def _outcomes(summary: dict[str, Any]) -> dict[str, tuple[int, int]]:
    """Return in how many cases each criterion of a report was met, of how many."""
    found: dict[str, tuple[int, int]] = {}
    for _, criterion in criteria_of(summary):
        name = str(criterion.get("name"))
        met, count = found.get(name, (0, 0))
        found[name] = met + (criterion.get("passed") is True), count + 1
    return found


def _in_words(outcome: tuple[int, int] | None) -> str:
    return "not judged" if outcome is None else f"met in {outcome[0]} of {outcome[1]}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Chart:
    """One quantity over the runs."""

    changes: tuple[tuple[ListedRun, Change], ...]  # of each run since the first
    most: float  # the change at the upper end of the chart


def charts_of(judged: Sequence[Judged]) -> list[Chart]:
    """Return a chart for each thing that ``check-press`` looks at."""
    states = [(each.run, each.state.changes) for each in judged if each.state is not None]
    charts = []
    for k in range(len(states[0][1]) if states else 0):
        changes = tuple((run, found[k]) for run, found in states)
        reach = [abs(change.value) + COVERAGE * change.uncertainty for _, change in changes]
        charts.append(Chart(changes=changes, most=_ROOM * max(changes[0][1].limit, *reach)))
    return charts


def in_words(value: float, change: Change) -> str:
    """Return a number in the unit of a change."""
    digits, factor, unit = (2, 1.0, change.unit) if change.unit else (1, 100.0, "%")
    return f"{round(factor * value, digits) + 0.0:+.{digits}f} {unit}"
