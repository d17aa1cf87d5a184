"""Compare a press with an earlier one of the same tool: keep, recalibrate or replace the gel.

No simulator is involved.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np
from scipy.optimize import least_squares

from reports.evidence.frames_and_curves import AttemptReading, RunReading
from sim.optics.calibrate.cross_validation import detail
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
"""Part of the earlier press's image change that differs now, at equal force, light and place."""
PLACE_CHANGE_PX = 1.5
"""Of the contact in the image: more than an arm's repeatability, less than scales bear."""
PATTERN_CHANGE = 0.7  # part of the gel's pattern (dust, texture, dots) that is another now
ZERO_CHANGE_N = 1.0  # of the force cell's zero; remounting a tool changes it by less
LIGHT_DOUBT = 0.01  # standard uncertainty of the brightness: warming up and the room
COVERAGE = 2.0
"""A change counts beyond its limit, and beyond this many of its standard uncertainties."""
_FIRST_SHARE = 0.3  # of the common force: below it the height of first contact decides
_LEVELS, _BLOCK_PX = 12, 4
# Of a pattern: how clear it is within one run at least, and of the gel around contacts
_CLEAR, _STILL_PX, _STILL_LEVELS = 0.15, 4.0, 1.5
FORCE_DOUBT = 0.01  # of the common force, at each level: noise, and creep at another pace


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
    limit: float  # a change beyond it, either way, counts if it is significant
    uncertainty: float = 0.0  # standard uncertainty, as ``value``
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
    # Of each colour, for one lamp may fade.
    colours, known = (np.maximum(each.unloaded.mean(axis=(0, 1)), 1.0) for each in (now, before))
    dimmer = float(max(colours / known - 1.0, key=abs))
    light = Change(name="light", value=dimmer, uncertainty=LIGHT_DOUBT, limit=LIGHT_CHANGE)
    was, shown = before.pressed - before.unloaded, (now.pressed - now.unloaded) * known / colours
    (right, below), _ = _shift(*(np.linalg.norm(each, axis=-1) for each in (was, shown)))
    place = Change(name="place", value=math.hypot(right, below), limit=PLACE_CHANGE_PX, unit="px")
    pattern = Change(name="pattern", value=_pattern_change(before, now), limit=PATTERN_CHANGE)
    # What differs at equal light and place; blocks average the noise.
    back = np.array([[1.0, 0.0, -right], [0.0, 1.0, -below]])
    shown = cv2.warpAffine(shown, back, shown.shape[1::-1], borderMode=cv2.BORDER_REPLICATE)
    was, shown = _reduced(was), _reduced(np.asarray(shown, np.float64))
    differs = float(np.linalg.norm(shown - was)) / max(float(np.linalg.norm(was)), 1e-9)
    image = Change(name="image", value=differs, limit=IMAGE_CHANGE)
    zero = Change(
        name="zero of the force cell",
        value=now.zero_n - before.zero_n,
        uncertainty=math.hypot(before.zero_deviation_n, now.zero_deviation_n),
        limit=ZERO_CHANGE_N,
        unit="N",
    )
    way = "harder" if modulus.value > 0.0 else "softer"
    reasons = {
        modulus: f"the gel is {way} by {abs(modulus.value):.0%}",
        image: f"{image.value:.0%} of the contact's image differs at equal force",
        pattern: "the gel's pattern is that of another gel: `tacauchy-rig calibrate optics`",
        place: f"the contact lies {right:+.1f} px to the right and {below:+.1f} px below; camera "
        "or sensor moved: `tacauchy-rig calibrate scale`",
        light: f"the light changed by {light.value:+.0%}: `tacauchy-rig calibrate optics`",
        zero: f"the cell's zero moved by {zero.value:+.2f} N: see its gain by `run --check-weight`",
    }
    first = next((each for each in reasons if each.counts), None)
    reason = "nothing changed beyond its limit" if first is None else reasons[first]
    advice = Advice.RECALIBRATE if first else Advice.KEEP
    advice = Advice.REPLACE if first in (modulus, image) else advice
    changes = (modulus, light, image, zero, place, pattern)
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


def _shift(before: FloatArray, now: FloatArray) -> tuple[tuple[float, float], float]:
    """Return how far an image moved to the right and down [px], and how clearly: 0 to about 1."""
    window = cv2.createHanningWindow(before.shape[1::-1], cv2.CV_32F)
    first, second = (np.asarray(each, np.float32) for each in (before, now))
    (right, below), clear = cv2.phaseCorrelate(first, second, window)
    return (right, below) if clear > _CLEAR else (0.0, 0.0), clear


def _pattern_change(before: PressMeasures, now: PressMeasures) -> float:
    """Return which part of the gel's pattern around the contacts is another; 0 if none is clear."""
    dents = [np.abs(each.pressed - each.unloaded).max(axis=-1) for each in (before, now)]
    still = cv2.GaussianBlur(np.max(dents, axis=0), (0, 0), _STILL_PX) < _STILL_LEVELS
    around = cv2.GaussianBlur(still.astype(np.float64), (0, 0), _STILL_PX)
    images = (before.unloaded, now.unloaded, now.pressed)
    was, shown, pressed = (around * detail(each) for each in images)
    clear = _shift(shown, pressed)[1]
    return max(0.0, 1.0 - _shift(was, shown)[1] / clear) if clear > _CLEAR else 0.0


def _reduced(change: FloatArray) -> FloatArray:
    size = max(1, change.shape[1] // _BLOCK_PX), max(1, change.shape[0] // _BLOCK_PX)
    return np.asarray(cv2.resize(change, size, interpolation=cv2.INTER_AREA), dtype=np.float64)
