"""Simulated contact pressure along two lines: a map's colours would all go to the rim's peak."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from reports.comparison.results import ValidationReport
from reports.figures.trials import force_title, shown
from tacauchy_rig.core.figure_style import PAGE_IN, letter, new_figure

_KPA, _MM = 1e-3, 1e3
_LIGHTEST = 0.9  # of the colour map, whose end is too light for a line


def draw_pressure(report: ValidationReport) -> Figure:
    """Draw the profiles along x and y, one line a force."""
    trials = [t for t in shown(report.evidence.trials) if t.pressure is not None]
    figure = new_figure(PAGE_IN, 2.1, marks=report.evidence.marks)
    panels = figure.subplots(1, 2, sharey=True)
    colors = mpl.colormaps["cividis"](np.linspace(0.0, _LIGHTEST, len(trials)))
    for axes, name in zip(panels, "xy", strict=True):
        for trial, color in zip(trials, colors, strict=True):
            profile = trial.pressure
            if profile is None:
                continue
            pressure = profile.on_x_pa if name == "x" else profile.on_y_pa
            axes.plot(profile.along_m * _MM, pressure * _KPA, color=color, label=force_title(trial))
        axes.set_xlabel(f"${name}$ from the tip (mm)")
        axes.grid(visible=True)
        letter(axes, "(a)" if name == "x" else "(b)")
    panels[0].set_ylim(bottom=0.0)  # of both, once all lines are there to be seen
    panels[0].set_ylabel("Contact pressure (kPa)")
    panels[1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure
