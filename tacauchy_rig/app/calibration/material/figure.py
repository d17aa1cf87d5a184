"""The valley of modulus and Poisson's ratio, and the profiles of what one wants to know."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from scipy.stats import chi2

from tacauchy_rig.app.calibration.material.fit import LEVEL, MU, NU, GelFit, Interval
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.figure_style import (
    BLUE,
    GREY,
    ORANGE,
    PAGE_IN,
    SIMULATED_MARK,
    STYLE,
    letter,
    new_figure,
    save_figure,
)

_HEIGHT_IN, _TOP = 2.3, 12.0
_LEVELS = tuple(float(chi2.ppf(p, 2)) for p in (0.68, 0.95, 0.997))
_PA_PER_KPA = 1e3


def draw_valley(fit: GelFit, stem: Path, *, simulated: bool, stated: tuple[float, float]) -> None:
    """Write ``stem`` as PDF and PNG.

    Args:
        fit: What forces tell.
        stem: Without a suffix.
        simulated: Whether the presses are emulated.
        stated: Modulus [Pa] and Poisson's ratio of the sensor's file.

    Raises:
        RecordError: It cannot be written.
    """
    with mpl.rc_context(STYLE):
        figure = new_figure(PAGE_IN, _HEIGHT_IN, marks=(SIMULATED_MARK,) if simulated else ())
        valley, nu, mu = figure.subplots(1, 3)
        _draw_map(valley, fit, stated)
        _draw_profile(nu, NU, fit.misfit.min(axis=1), fit.poisson)
        _draw_profile(mu, MU, fit.misfit.min(axis=0), fit.friction)
        nu.set_xlabel("Poisson's ratio $\\nu$")
        mu.set_xlabel("Friction coefficient $\\mu$")
        nu.set_ylabel("$\\chi^2$ above its least")
        for axes, name in ((valley, "(a)"), (nu, "(b)"), (mu, "(c)")):
            letter(axes, name)
        save_figure(figure, stem.parent, stem.name)


def _draw_map(axes: Axes, fit: GelFit, stated: tuple[float, float]) -> None:
    young = fit.young_values
    above = fit.valley(young) - fit.misfit.min()
    inside = young[(above < _LEVELS[-1]).any(axis=1)] / _PA_PER_KPA
    axes.contourf(NU, young / _PA_PER_KPA, above, levels=[0.0, *_LEVELS], colors=_SHADES)
    nu, mu = fit.best
    axes.plot(NU[nu], fit.young_pa[nu, mu] / _PA_PER_KPA, "o", color=ORANGE, markersize=4)
    axes.plot(stated[1], stated[0] / _PA_PER_KPA, "x", color=GREY, markersize=5)
    axes.set_ylim(0.97 * inside.min(), 1.03 * inside.max())
    axes.set_xlim(NU[0], NU[-1])
    axes.set_xlabel("Poisson's ratio $\\nu$")
    axes.set_ylabel("Modulus $E$ (kPa)")


_SHADES = ("#0072B2", "#6BAED6", "#C6DBEF")


def _draw_profile(axes: Axes, values: FloatArray, profile: FloatArray, told: Interval) -> None:
    axes.plot(values, np.minimum(profile - profile.min(), 2.0 * _TOP), color=BLUE)
    axes.axhline(LEVEL, color=GREY, linestyle="--", linewidth=0.7)
    low = values[0] if told.low is None else told.low
    high = values[-1] if told.high is None else told.high
    axes.axvspan(low, high, color="#D9D9D9", linewidth=0, zorder=0)
    axes.set_ylim(0.0, _TOP)
    axes.set_xlim(values[0], values[-1])
