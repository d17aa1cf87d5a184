"""Two runs beside each other, number by number."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from tacauchy_rig.app.results.found_runs import FoundRun

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
        squares = sum((each or 0.0) ** 2 for each in (self.one[1], self.other[1]))
        return self.difference / squares**0.5 if squares > 0.0 else None


def compare(one: FoundRun, other: FoundRun) -> list[Row]:
    """Return what the reports of two runs say, beside each other."""
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
    return {
        trial["index"]: trial for trial in trials if isinstance(trial, dict) and "index" in trial
    }


def _of_trial(trial: dict[str, Any], name: str, spread: str | None, factor: float) -> Value:
    value = trial.get(name)
    if not isinstance(value, (int, float)):
        return None
    deviation = trial.get(spread) if spread else None
    return factor * value, factor * deviation if isinstance(deviation, (int, float)) else None
