"""Where the uncertainty of a predicted force comes from."""

from __future__ import annotations

from matplotlib.figure import Figure

from reports.comparison.results import TrialResult, ValidationReport
from tacauchy_rig.core.figure_style import BLUE, COLUMN_IN, ORANGE, SKY, new_figure

SMALL_SHARE = 0.01
"""Of the sum; a term below it at both forces is not drawn."""
_ROW_IN, _REST_IN = 0.17, 0.75


def budgeted(report: ValidationReport) -> list[TrialResult]:
    """Return the trials with a predicted force and a budget, the smallest force first."""
    known = [t for t in report.trials if t.force.combined and t.force.force_predicted_n]
    return sorted(known, key=lambda t: t.force_target_n)


def draw_budget(report: ValidationReport) -> Figure:
    """Draw each term over the predicted force, of the smallest and the largest force."""
    trials = budgeted(report)
    ends = [trials[0], trials[-1]] if len(trials) > 1 else trials
    rows = _rows(ends)
    height_in = _ROW_IN * len(rows) + _REST_IN
    figure = new_figure(COLUMN_IN, height_in, marks=report.evidence.marks)
    axes = figure.subplots()
    thick = 0.8 / len(ends)
    for which, (trial, color) in enumerate(zip(ends, (SKY, BLUE), strict=False)):
        places = [row + (which - 0.5 * (len(ends) - 1)) * thick for row in range(len(rows))]
        values = [percent[which] for _, percent in rows]
        bars = axes.barh(places, values, thick, color=color, label=f"{trial.force_target_n:.2f} N")
        bars[-1].set_facecolor(ORANGE)
        bars[-1].set_alpha(0.5 if which == 0 else 1.0)
    axes.axhline(len(rows) - 2.5, color="black", linewidth=0.5)
    axes.set_yticks(range(len(rows)), [name for name, _ in rows])
    axes.invert_yaxis()
    axes.set_xlabel("Of the predicted force (%)")
    axes.grid(axis="x")
    axes.legend(loc="center right")
    return figure


def _rows(trials: list[TrialResult]) -> list[tuple[str, list[float]]]:
    """Return name and per cent of each trial: terms by size, then their sum, then the error.

    Trials of several indenters have terms of their own.
    """
    terms = []
    known = [{term.name: term.value_n for term in t.force.budget} for t in trials]
    for name in dict.fromkeys(name for own in known for name in own):
        values = [_percent(t, own.get(name)) for t, own in zip(trials, known, strict=True)]
        sums = [_percent(t, t.force.known_uncertainty_n) for t in trials]
        if any(v > SMALL_SHARE * s for v, s in zip(values, sums, strict=True)):
            terms.append((name, values))
    terms.sort(key=lambda row: -max(row[1]))
    together = [_percent(t, t.force.known_uncertainty_n) for t in trials]
    error = [_percent(t, abs(t.force.prediction_error_n or 0.0)) for t in trials]
    return [*terms, ("all together, $u_{val}$", together), ("error of the prediction", error)]


def _percent(trial: TrialResult, value_n: float | None) -> float:
    return 100.0 * (value_n or 0.0) / (trial.force.force_predicted_n or 1.0)
