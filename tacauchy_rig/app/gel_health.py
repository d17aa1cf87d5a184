"""Compare a press with an earlier one of the same tool: keep, recalibrate or replace the gel.

A gel that hardens or tears changes its force at a depth. Light that fades and a gel that wears
change the image. No simulator is involved.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np
from scipy.optimize import least_squares

from reports.evidence.frames_and_curves import AttemptReading, RunReading
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.config.settings import stated_uncertainty
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import FZ

MODULUS_CHANGE = 0.08
"""Relative change of stiffness that spoils a predicted force: twice what a calibration of the gel
leaves uncertain (3.6 %, docs/results/calibration.md)."""
LIGHT_CHANGE = 0.08
"""Relative change of the unloaded image's brightness that a calibration of colours does not cover;
lights that warm up change by 2 %."""
IMAGE_CHANGE = 0.25
"""Part of the earlier press's image change that differs now, at equal force and brightness."""
ZERO_CHANGE_N = 1.0
"""Of the force cell's zero; remounting a tool changes it by less."""
LIGHT_DOUBT = 0.01
"""Standard uncertainty of the brightness: warming up and the room."""
COVERAGE = 2.0
"""A change counts beyond its limit, and beyond this many of its standard uncertainties."""
_FIRST_SHARE = 0.3
"""Of the common force: below it the height of first contact decides."""
_LEVELS = 12
_BLOCK_PX = 4
FORCE_DOUBT = 0.01
"""Of the common force, at each level: noise, and creep at another pace."""


class Advice(StrEnum):
    """What to do with the sensor."""

    KEEP = "keep"
    RECALIBRATE = "recalibrate"
    REPLACE = "replace the gel"


@dataclass(frozen=True, slots=True, kw_only=True)
class PressMeasures:
    """What was measured of one press."""

    depth_m: FloatArray  # below first contact while the force rises, shape [n]
    force_n: FloatArray  # likewise [N]
    unloaded: FloatArray  # no-contact image [grey levels], shape [height, width, 3]
    pressed: FloatArray  # image of the dwell, likewise
    zero_n: float  # raw reading of the unloaded cell along its axis
    zero_deviation_n: float  # standard deviation of it


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """How much one property changed."""

    name: str
    value: float  # in ``unit``; a ratio if that is empty
    uncertainty: float  # standard uncertainty, likewise
    limit: float  # a change beyond it, either way, counts if it is significant
    unit: str = ""

    @property
    def counts(self) -> bool:
        """True where it is beyond its limit and significant."""
        return abs(self.value) > max(self.limit, COVERAGE * self.uncertainty)


@dataclass(frozen=True, slots=True, kw_only=True)
class GelState:
    """The verdict, and why."""

    advice: Advice
    reason: str
    changes: tuple[Change, ...]


def compare_runs(before: RunReading, now: RunReading) -> GelState:
    """Compare a run's press with the one of an earlier run that is nearest to it in force."""
    press = _nearest(now, None)
    error_m = stated_uncertainty(now.store.config, "depth").value
    known = _nearest(before, press.record.force_measured_n)
    return compare_presses(_measures(known), _measures(press), depth_uncertainty_m=error_m)


def nearest_force_n(run: RunReading, force_n: float) -> float:
    """Return the target [N] of the passed press of a run that is nearest to a force [N]."""
    return _nearest(run, force_n).record.force_target_n


def _nearest(run: RunReading, force_n: float | None) -> AttemptReading:
    passed = [each for each in run.records.values() if each is not None and each.passed]
    if not passed:
        raise RecordError(
            f"{run.store.paths.root}: none of its presses passed",
            remedy="name a run with a passed press: `tacauchy-rig run rig.toml --press-only`",
        )
    wanted_n = passed[0].force_target_n if force_n is None else force_n
    return run.read(min(passed, key=lambda each: abs(each.force_target_n - wanted_n)))


def _measures(attempt: AttemptReading) -> PressMeasures:
    """Return what was measured of a passed press, up to the beginning of its dwell."""
    force, depth, images = attempt.force_curve, attempt.depth_curve, attempt.images
    tare = attempt.record.tare_before
    name = f"trial {attempt.record.index} of {attempt.store.paths.root}"
    if force is None or depth is None or images is None or tare is None:
        raise RecordError(f"{name}: images, zero or contact are missing", remedy="name another run")
    depth_m = np.interp(force.time_s, depth.time_s, depth.value)
    rises = (force.time_s < 0.0) & (force.time_s > depth.time_s[0]) & (depth_m > 0.0)
    if not rises.any():
        raise RecordError(
            f"{name}: no force was recorded between its contact and its dwell",
            remedy="name another run",
        )
    return PressMeasures(
        depth_m=depth_m[rises],
        force_n=force.value[rises],
        unloaded=images.reference.astype(np.float64),
        pressed=images.real.astype(np.float64),
        zero_n=tare.mean[FZ],
        zero_deviation_n=tare.deviation[FZ],
    )


def compare_presses(
    before: PressMeasures, now: PressMeasures, *, depth_uncertainty_m: float
) -> GelState:
    """Compare two presses by the same tool at the same place.

    Args:
        before: Of the sensor in good order.
        depth_uncertainty_m: Standard uncertainty of a depth of one press [m].

    Raises:
        RecordError: The presses have no forces in common, or images of different sizes.
    """
    if before.unloaded.shape != now.unloaded.shape:
        raise RecordError(
            f"images of {before.unloaded.shape} and {now.unloaded.shape} cannot be compared",
            remedy="press with the camera mode and the sensor file of the earlier run",
        )
    modulus = _stiffness(before, now, depth_uncertainty_m)
    light_now = float(now.unloaded.mean() / max(before.unloaded.mean(), 1.0))
    light = Change(name="light", value=light_now - 1.0, uncertainty=LIGHT_DOUBT, limit=LIGHT_CHANGE)
    # The part of the contact's image change that differs at equal light; blocks average the noise.
    was = _reduced(before.pressed - before.unloaded)
    shown = _reduced(now.pressed - now.unloaded) / max(light_now, 1e-3)
    differs = float(np.linalg.norm(shown - was)) / max(float(np.linalg.norm(was)), 1e-9)
    image = Change(name="image", value=differs, uncertainty=0.0, limit=IMAGE_CHANGE)
    zero = Change(
        name="zero of the force cell",
        value=now.zero_n - before.zero_n,
        uncertainty=math.hypot(before.zero_deviation_n, now.zero_deviation_n),
        limit=ZERO_CHANGE_N,
        unit="N",
    )
    changes = (modulus, light, image, zero)
    advice, reason = Advice.KEEP, "nothing changed beyond its limit"
    if modulus.counts:
        way = "harder" if modulus.value > 0.0 else "softer"
        advice, reason = Advice.REPLACE, f"the gel is {way} by {abs(modulus.value):.0%}"
    elif image.counts:
        advice = Advice.REPLACE
        reason = f"{image.value:.0%} of the contact's image differs at equal force"
    elif light.counts:
        advice = Advice.RECALIBRATE
        reason = f"the light changed by {light.value:+.0%}: `tacauchy-rig calibrate optics`"
    elif zero.counts:
        advice = Advice.RECALIBRATE
        reason = f"the cell's zero moved by {zero.value:+.2f} N: see its gain by "
        reason += "`run --check-weight`"
    return GelState(advice=advice, reason=reason, changes=changes)


def _stiffness(before: PressMeasures, now: PressMeasures, depth_uncertainty_m: float) -> Change:
    """Return k - 1 of force_now(d) = k force_before(d + s); s is an error of the first contact."""
    most_n = min(float(before.force_n.max()), float(now.force_n.max()))
    if not most_n > 0.0:
        raise RecordError("a press without force cannot be compared", remedy="press again")
    levels = np.linspace(_FIRST_SHARE, 1.0, _LEVELS) * most_n
    order = np.argsort(now.force_n)
    depth_m = np.interp(levels, now.force_n[order], now.depth_m[order])
    order = np.argsort(before.depth_m)
    degree = min(3, len(order) - 1)
    curve = np.polynomial.Polynomial.fit(before.depth_m[order], before.force_n[order], degree)
    doubt_n, doubt_m = FORCE_DOUBT * most_n, math.sqrt(2.0) * depth_uncertainty_m

    def off(parameters: FloatArray) -> FloatArray:
        factor, shift_m = parameters
        return np.append((levels - factor * curve(depth_m + shift_m)) / doubt_n, shift_m / doubt_m)

    found = least_squares(off, [1.0, 0.0], x_scale=[1.0, doubt_m])
    covariance = np.linalg.inv(found.jac.T @ found.jac)
    return Change(
        name="modulus",
        value=float(found.x[0]) - 1.0,
        uncertainty=math.sqrt(float(covariance[0, 0])),
        limit=MODULUS_CHANGE,
    )


def _reduced(change: FloatArray) -> FloatArray:
    size = max(1, change.shape[1] // _BLOCK_PX), max(1, change.shape[0] // _BLOCK_PX)
    return np.asarray(cv2.resize(change, size, interpolation=cv2.INTER_AREA), dtype=np.float64)
