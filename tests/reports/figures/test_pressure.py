"""Profiles of pressure: one line a force, in both panels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from reports.comparison.results import ValidationReport
from reports.evidence.evidence import PressureProfile
from reports.figures.forces import draw_pressure


def test_trials_without_pressure_have_no_line(report: ValidationReport) -> None:
    """Of six trials two have been replayed: two lines along x and two along y, in kPa and mm."""
    along = np.linspace(-2e-3, 2e-3, 5)
    profile = PressureProfile(along_m=along, on_x_pa=np.full(5, 1e5), on_y_pa=np.full(5, 2e5))
    evidence = report.evidence
    trials = tuple(replace(t, pressure=profile if t.index < 3 else None) for t in evidence.trials)
    figure = draw_pressure(replace(report, evidence=replace(evidence, trials=trials)))
    on_x, on_y = figure.axes
    assert [len(axes.lines) for axes in (on_x, on_y)] == [2, 2]
    np.testing.assert_allclose(on_y.lines[0].get_ydata(), 200.0)
    np.testing.assert_allclose(on_x.lines[0].get_xdata(), along * 1e3)
    assert on_y.get_ylim()[0] == 0.0
    assert on_y.get_ylim()[1] > 200.0
