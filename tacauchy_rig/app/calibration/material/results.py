"""What a fit leads to: the sensor's file with its gel, the relaxation beside it, and its figure."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from scipy.optimize import OptimizeWarning, curve_fit
from scipy.stats import chi2

from sim.sensor.sensor import parse_sensor
from tacauchy_rig.app.calibration.material.fit import LEVEL, MU, NU, GelFit, Interval
from tacauchy_rig.app.replay.opening import open_run
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.figure_style import (
    BLUE,
    GREY,
    ORANGE,
    PAGE_IN,
    STYLE,
    letter,
    new_figure,
    save_figure,
)
from tacauchy_rig.core.registry import Kind, load, unknown
from tacauchy_rig.core.run import SIMULATED_MARK


def sensor_text(name: str) -> str:
    """Return the text of a sensor's file, built in or by its path.

    Raises:
        ConfigError: It cannot be read.
    """
    path: Path = Path(name) if unknown(Kind.SENSOR, name) else load(Kind.SENSOR, name)
    try:
        return path.read_text("utf-8")
    except OSError as error:
        raise ConfigError(f"sensor {name}: {error.strerror}", remedy="give its path") from error


def with_gel(text: str, *, young: Interval, poisson: Interval, source: str) -> str:
    """Return the file's text with the fitted values of its gel; what the fit leaves open stays.

    Raises:
        ConfigError: It has no line ``young = `` in ``[material]``.
    """
    for key, found, factor, unit in (
        ("young", young, 1e-6, " MPa"),
        ("poisson", poisson, 1.0, ""),
    ):
        if found.uncertainty is None:
            continue
        line = (
            f'{key} = {{ value = "{found.best * factor:.5g}{unit}", uncertainty = '
            f'"{found.uncertainty * factor:.2g}{unit}", source = "{source}" }}'
        )
        # A source may hold a backslash, which a replacement would read as its own.
        escaped = line.replace("\\", r"\\")
        text, count = re.subn(rf"(?m)^{key} = \{{.*\}}[ \t]*$", escaped, text)
        if count != 1:
            raise ConfigError(
                f"the sensor's file has {count} lines `{key} = {{ ... }}`",
                remedy="write it as one line in [material]",
            )
    parse_sensor(text, origin="the calibrated sensor's file")
    return text


_SURE = 2.0
"""Standard uncertainties by which share and time are to be above none."""
_FIRST = (0.02, 0.3)
"""Share and time [s] that a fit begins with: what silicone gels have."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DwellTerm:
    """What of the force is still to be lost when the dwell begins, and how fast it goes.

    Attributes:
        share: Of the force at the dwell's begin; less than the gel's, which lost some on the way.
        time_s: Time constant [s].
    """

    share: float
    share_error: float
    time_s: float
    time_error_s: float

    def __str__(self) -> str:
        return (
            f"relaxes by {self.share:.2%} +- {self.share_error:.2%} from the dwell on, in "
            f"{self.time_s:.2g} +- {self.time_error_s:.1g} s"
        )


def relaxation_of(folder: Path) -> DwellTerm | None:
    """Fit all dwells of a run together; None where they show no relaxation.

    Raises:
        RecordError: It is no run's folder, or a recording is damaged.
    """
    run = open_run(folder)
    parts = [np.zeros((2, 0))]
    for record in run.records.values():
        attempt = None if record is None else run.read(record)
        if attempt is None or attempt.force_curve is None or attempt.dwell_s is None:
            continue
        curve, (start_s, end_s) = attempt.force_curve, attempt.dwell_s
        held = (curve.time_s >= start_s) & (curve.time_s <= end_s)
        if held.any():
            share = curve.value[held] / curve.value[held].mean()
            parts.append(np.stack([curve.time_s[held], share]))
    return fit_term(*np.concatenate(parts, axis=1))


def fit_term(time_s: FloatArray, force: FloatArray) -> DwellTerm | None:
    """Fit ``a (1 + b exp(-t / tau))`` to forces over their mean.

    Args:
        time_s: From the dwell's begin [s], shape [sample_count].
        force: Likewise.
    """
    if len(time_s) < 10 * len(_FIRST):
        return None
    try:
        found, covariance = curve_fit(_held, time_s, force, p0=(1.0, *_FIRST))
    except (RuntimeError, OptimizeWarning):
        return None
    (_, share, tau), (_, share_error, tau_error) = found, np.sqrt(np.diag(covariance))
    is_bounded = share > _SURE * share_error and tau > _SURE * tau_error
    if not is_bounded or tau > time_s.max():
        return None
    return DwellTerm(
        share=float(share),
        share_error=float(share_error),
        time_s=float(tau),
        time_error_s=float(tau_error),
    )


def _held(time_s: FloatArray, level: float, share: float, tau: float) -> FloatArray:
    return np.asarray(level * (1.0 + share * np.exp(-time_s / max(tau, 1e-3))))


_FIGURE_HEIGHT_IN, _TOP = 2.3, 12.0
_LEVELS = tuple(float(chi2.ppf(p, 2)) for p in (0.68, 0.95, 0.997))
_SHADES = ("#0072B2", "#6BAED6", "#C6DBEF")


def draw_valley(fit: GelFit, stem: Path, *, simulated: bool, stated: tuple[float, float]) -> None:
    """Write ``stem`` as PDF and PNG.

    Args:
        stem: Without a suffix.
        simulated: Whether the presses are emulated.
        stated: Modulus [Pa] and Poisson's ratio of the sensor's file.

    Raises:
        RecordError: It cannot be written.
    """
    with mpl.rc_context(STYLE):
        marks = (SIMULATED_MARK,) if simulated else ()
        figure = new_figure(PAGE_IN, _FIGURE_HEIGHT_IN, marks=marks)
        valley, nu, mu = figure.subplots(1, 3)
        _draw_map(valley, fit, stated)
        _draw_profile(nu, NU, fit.misfit.min(axis=1), fit.poisson)
        _draw_profile(mu, MU, fit.misfit.min(axis=0), fit.friction)
        nu.set(xlabel="Poisson's ratio $\\nu$", ylabel="$\\chi^2$ above its least")
        mu.set(xlabel="Friction coefficient $\\mu$")
        for axes, name in ((valley, "(a)"), (nu, "(b)"), (mu, "(c)")):
            letter(axes, name)
        save_figure(figure, stem.parent, stem.name)


def _draw_map(axes: Axes, fit: GelFit, stated: tuple[float, float]) -> None:
    young = fit.young_values
    above = fit.valley(young) - fit.misfit.min()
    inside = young[(above < _LEVELS[-1]).any(axis=1)] / 1e3
    axes.contourf(NU, young / 1e3, above, levels=[0.0, *_LEVELS], colors=_SHADES)
    nu, mu = fit.best
    axes.plot(NU[nu], fit.young_pa[nu, mu] / 1e3, "o", color=ORANGE, markersize=4)
    axes.plot(stated[1], stated[0] / 1e3, "x", color=GREY, markersize=5)
    axes.set(xlabel="Poisson's ratio $\\nu$", ylabel="Modulus $E$ (kPa)")
    axes.set(xlim=(NU[0], NU[-1]), ylim=(0.97 * inside.min(), 1.03 * inside.max()))


def _draw_profile(axes: Axes, values: FloatArray, profile: FloatArray, found: Interval) -> None:
    axes.plot(values, np.minimum(profile - profile.min(), 2.0 * _TOP), color=BLUE)
    axes.axhline(LEVEL, color=GREY, linestyle="--", linewidth=0.7)
    low = values[0] if found.low is None else found.low
    high = values[-1] if found.high is None else found.high
    axes.axvspan(low, high, color="#D9D9D9", linewidth=0, zorder=0)
    axes.set(xlim=(values[0], values[-1]), ylim=(0.0, _TOP))
