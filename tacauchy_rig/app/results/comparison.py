"""Two runs number by number, and one quantity over many runs as a chart."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from tacauchy_rig.app.gel_health.comparison import COVERAGE, Change
from tacauchy_rig.app.results.runs import Judged, ListedRun

# What a report says of all trials of a run: title, its place in the summary, factor and unit.
_OF_ALL = (
    ("SSIM", ("statistics", "metrics", "ssim"), 1.0, ""),
    ("SSIM without contact", ("statistics", "no_contact", "ssim"), 1.0, ""),
    ("NCC", ("statistics", "metrics", "ncc"), 1.0, ""),
    ("NCC without contact", ("statistics", "no_contact", "ncc"), 1.0, ""),
    ("PSNR", ("statistics", "metrics", "psnr_db"), 1.0, "dB"),
    ("unexplained of the contact", ("statistics", "contact_relative_residual"), 100.0, "%"),
    ("predicted force off by", ("statistics", "prediction_error_relative"), 100.0, "%"),
)
_OF_TRIALS = (
    ("force", "force_measured_n", "force_deviation_n", 1.0, "N"),
    ("depth", "depth_measured_m", None, 1e3, "mm"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """A number of both runs.

    Attributes:
        one, other: Value and standard deviation; None where a run does not know it.
    """

    title: str
    unit: str
    one: tuple[float, float | None] | None
    other: tuple[float, float | None] | None

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
    rows = [
        _row(title, unit, *(_of_all(s, place, factor) for s in summaries))
        for title, place, factor, unit in _OF_ALL
    ]
    rows.insert(0, _row("modulus, of the stated one", "", *(_modulus(s) for s in summaries)))
    for index in sorted(set(_trials(summaries[0])) & set(_trials(summaries[1]))):
        for title, name, spread, factor, unit in _OF_TRIALS:
            values = (_of_trial(_trials(s)[index], name, spread, factor) for s in summaries)
            rows.append(_row(f"{title} of trial {index}", unit, *values))
    return [row for row in rows if row.one is not None or row.other is not None]


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
    for place in (summary, *_trials(summary).values()):
        criteria = place.get("criteria")
        for criterion in criteria if isinstance(criteria, list | tuple) else ():
            if isinstance(criterion, dict):
                met, count = found.get(str(criterion.get("name")), (0, 0))
                passed = criterion.get("passed") is True
                found[str(criterion.get("name"))] = met + passed, count + 1
    return found


def _in_words(outcome: tuple[int, int] | None) -> str:
    return "not judged" if outcome is None else f"met in {outcome[0]} of {outcome[1]}"


Value = tuple[float, float | None] | None


def _row(title: str, unit: str, one: Value, other: Value) -> Row:
    return Row(title=title, unit=unit, one=one, other=other)


def _of_all(summary: dict[str, Any], place: tuple[str, ...], factor: float) -> Value:
    found: Any = summary
    for name in place:
        found = found.get(name) if isinstance(found, dict) else None
    if not isinstance(found, dict) or not isinstance(found.get("mean"), (int, float)):
        return None
    spread = found.get("deviation")
    return factor * found["mean"], factor * spread if isinstance(spread, (int, float)) else None


def _modulus(summary: dict[str, Any]) -> Value:
    model = summary.get("model")
    factor = model.get("modulus_factor") if isinstance(model, dict) else None
    if not isinstance(model, dict) or not isinstance(factor, (int, float)):
        return None
    spread = model.get("modulus_factor_deviation")
    return factor, spread if isinstance(spread, (int, float)) else None


def _trials(summary: dict[str, Any]) -> dict[int, dict[str, Any]]:
    found = summary.get("trials")
    trials = found if isinstance(found, list) else []
    known = [trial for trial in trials if isinstance(trial, dict)]
    return {trial["index"]: trial for trial in known if isinstance(trial.get("index"), int)}


def _of_trial(trial: dict[str, Any], name: str, spread: str | None, factor: float) -> Value:
    value = trial.get(name)
    if not isinstance(value, (int, float)):
        return None
    deviation = trial.get(spread) if spread else None
    return factor * value, factor * deviation if isinstance(deviation, (int, float)) else None


WIDTH, HEIGHT = 640.0, 180.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 56.0, 16.0, 12.0, 22.0
# Of the limit, shown beyond it and beyond what was found.
_ROOM = 1.4


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """A run's change in the picture: place, error bar, and what is said of it."""

    x: float
    y: float
    low: float
    high: float
    counts: bool
    title: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Chart:
    """One quantity over the runs.

    Attributes:
        upper, lower: Where the limits lie.
        zero: Where no change lies.
        bound: The limit in words.
    """

    name: str
    marks: tuple[Mark, ...]
    upper: float
    lower: float
    zero: float
    bound: str
    width: float = WIDTH
    height: float = HEIGHT
    left: float = _LEFT
    right: float = WIDTH - _RIGHT


def charts_of(judged: Sequence[Judged]) -> list[Chart]:
    """Return a chart for each thing that ``check-press`` looks at."""
    states = [(each, each.state) for each in judged if each.state is not None]
    if not states:
        return []
    names = [change.name for change in states[0][1].changes]
    return [_chart([(each, state.changes[k]) for each, state in states]) for k in range(len(names))]


def in_words(value: float, change: Change) -> str:
    """Return a number in the unit of a change."""
    digits, factor, unit = (2, 1.0, change.unit) if change.unit else (1, 100.0, "%")
    return f"{round(factor * value, digits) + 0.0:+.{digits}f} {unit}"


def _chart(found: Sequence[tuple[Judged, Change]]) -> Chart:
    first = found[0][1]
    reach = [abs(change.value) + COVERAGE * change.uncertainty for _, change in found]
    most = _ROOM * max(first.limit, *reach) if reach else first.limit

    def height(value: float) -> float:
        inside = HEIGHT - _TOP - _BOTTOM
        return round(_TOP + 0.5 * inside * (1.0 - value / most), 1)

    step = (WIDTH - _LEFT - _RIGHT) / (len(found) + 1)
    marks = tuple(
        Mark(
            x=round(_LEFT + (k + 1) * step, 1),
            y=height(change.value),
            low=height(change.value - COVERAGE * change.uncertainty),
            high=height(change.value + COVERAGE * change.uncertainty),
            counts=change.counts,
            title=f"{each.run.name}: {in_words(change.value, change)}",
        )
        for k, (each, change) in enumerate(found)
    )
    return Chart(
        name=first.name,
        marks=marks,
        upper=height(first.limit),
        lower=height(-first.limit),
        zero=height(0.0),
        bound=in_words(first.limit, first).lstrip("+"),
    )
