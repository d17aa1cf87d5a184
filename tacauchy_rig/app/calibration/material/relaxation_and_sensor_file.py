"""What a fit leads to: the sensor's file with its gel, and the relaxation beside it."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import OptimizeWarning, curve_fit

from sim.sensor.sensor import parse_sensor
from tacauchy_rig.app.calibration.material.fit_and_next_presses import Interval
from tacauchy_rig.app.replay.open_run import open_run
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.registry import Kind, load, unknown


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
    for key, found, factor, unit in (("young", young, 1e-6, " MPa"), ("poisson", poisson, 1.0, "")):
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


_SURE = 2.0  # standard uncertainties by which share and time are to be above none
_FIRST = (0.02, 0.3)  # share and time [s] that a fit begins with: what silicone gels have


@dataclass(frozen=True, slots=True, kw_only=True)
class DwellTerm:
    """What of the force is still to be lost when the dwell begins, and how fast it goes."""

    # Of the force at the dwell's begin; less than the gel's, which lost some on the way
    share: float
    share_error: float
    time_s: float  # time constant [s]
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
