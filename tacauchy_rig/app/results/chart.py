"""Points with error bars over runs, as places in a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tacauchy_rig.app.gel_health.comparison import COVERAGE, Change
from tacauchy_rig.app.results.health import Judged

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
