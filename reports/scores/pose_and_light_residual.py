"""Shift and change of light between a simulated and a real contact, and scores without them.

These stand second to the raw scores, and say what was corrected.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from reports.scores import contact_scores
from reports.scores.image_metrics import ImageScores, score
from tacauchy_rig.core.arrays import BoolArray, FloatArray, ImageArray

PYRAMID_PX = (6.0, 3.0, 1.5)
STEP_TOLERANCE_PX = 1e-3
MAX_STEPS = 30
MAX_STEP_PX = 4.0
FAINTEST_AMPLITUDE = 1e-6  # of the real change: what is fainter has no place
LIGHT_MARGIN_RADII = 0.75
LIGHT_SMOOTHING_PX = 2.0
MIN_LIGHT_FRACTION = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseResidual:
    """Translation that brings the simulated contact onto the real one."""

    x_px: float  # positive: the real contact lies to the right of the simulated one [px]
    y_px: float  # positive: the real contact lies below the simulated one [px]
    x_mm: float | None = None  # the same in mm; None when the scale is unknown
    y_mm: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LightResidual:
    """real = gain * simulated + offset, fitted per channel (R, G, B) outside the contact."""

    gain: tuple[float, float, float]
    offset: tuple[float, float, float]  # [grey level]
    pixel_fraction: float  # part of the frame that the fit used


@dataclass(frozen=True, slots=True, kw_only=True)
class Corrections:
    """Residuals of pose and light, and the scores with them taken out."""

    pose: PoseResidual | None
    light: LightResidual | None
    metrics_pose_corrected: ImageScores | None
    metrics_pose_light_corrected: ImageScores | None
    # The light is taken out of the no-contact frame as well.
    contact_pose_light_corrected: contact_scores.ContactScores | None


def correct(
    real: ImageArray,
    simulated: ImageArray,
    reference: ImageArray,
    *,
    scale_mm_px: tuple[float, float] | None = None,
    seen: contact_scores.Touched | None = None,
) -> Corrections | None:
    """Fit pose and light residuals and score again; arguments as of ``score_contact``.

    Returns:
        None when the real image shows no contact.
    """
    real_change, simulated_change = (
        contact_scores.image_change(seen, reference) for seen in (real, simulated)
    )
    seen = seen or contact_scores.touched_by(real_change)
    if seen is None:
        return None
    shift = register_changes(real_change, simulated_change, seen.region)
    light = fit_light(real, simulated, seen.footprint)
    moved = simulated
    if shift is not None:
        moved = _to_image(reference + shift_change(simulated_change, *shift))
    lit = moved if light is None else apply_light(moved, light)
    return Corrections(
        pose=None if shift is None else _pose(shift, scale_mm_px),
        light=light,
        metrics_pose_corrected=None if shift is None else score(real, moved),
        metrics_pose_light_corrected=None if light is None else score(real, lit),
        contact_pose_light_corrected=None
        if light is None
        else contact_scores.score_contact(
            real, lit, apply_light(reference, light), scale_mm_px=scale_mm_px
        ),
    )


def register_changes(
    real: FloatArray, simulated: FloatArray, region: BoolArray
) -> tuple[float, float] | None:
    """Find the translation (x, y) [px] of ``simulated`` that fits ``real`` best inside ``region``.

    Gauss-Newton on all channels from coarse to fine smoothing, with one free amplitude so that a
    weaker simulated contact is not mistaken for a shifted one. None when the fit leaves the
    region's own size.
    """
    x, y = 0.0, 0.0
    reach = contact_scores.footprint_radius(region)
    around = contact_scores.rectangle_around(region, margin_px=1)  # for the gradients at its edge
    real, simulated = (change - np.median(change, axis=(0, 1)) for change in (real, simulated))
    for smoothing in PYRAMID_PX:
        target = smooth_change(real, smoothing)[region].ravel()
        source = smooth_change(simulated, smoothing)
        for _ in range(MAX_STEPS):
            step = _register_step(target, shift_change(source, x, y, around), region[around])
            x, y = x + step[0], y + step[1]
            if math.hypot(x, y) > reach:
                return None
            if math.hypot(*step) < STEP_TOLERANCE_PX:
                break
    return x, y


def smooth_change(change: FloatArray, sigma_px: float) -> FloatArray:
    """Take the noise off a change of an image, by a Gaussian of that standard deviation [px]."""
    return np.asarray(cv2.GaussianBlur(change, (0, 0), sigma_px), dtype=np.float64)


def _register_step(target: FloatArray, moved: FloatArray, region: BoolArray) -> tuple[float, float]:
    columns = [moved, -np.gradient(moved, axis=1), -np.gradient(moved, axis=0)]
    matrix = np.stack([column[region].ravel() for column in columns], axis=1)
    amplitude, along_x, along_y = np.linalg.lstsq(matrix, target, rcond=None)[0]
    if abs(amplitude) < FAINTEST_AMPLITUDE:
        return math.inf, math.inf
    x, y = np.clip(np.array([along_x, along_y]) / amplitude, -MAX_STEP_PX, MAX_STEP_PX).tolist()
    return x, y


def shift_change(
    change: FloatArray, x_px: float, y_px: float, part: tuple[slice, slice] | None = None
) -> FloatArray:
    """Move a change by (x, y) [px]; what comes in from outside is unchanged gel, so zero.

    Args:
        part: Rows and columns that are wanted; None are all.
    """
    rows, columns = part or (slice(0, change.shape[0]), slice(0, change.shape[1]))
    matrix = np.array([[1.0, 0.0, x_px - columns.start], [0.0, 1.0, y_px - rows.start]])
    size = columns.stop - columns.start, rows.stop - rows.start
    moved = cv2.warpAffine(change, matrix, size, flags=cv2.INTER_CUBIC)
    return np.asarray(moved, dtype=np.float64)


def fit_light(
    real: ImageArray, simulated: ImageArray, footprint: BoolArray
) -> LightResidual | None:
    """Fit gain and offset per channel well outside the contact; None if too little lies there."""
    margin = LIGHT_MARGIN_RADII * contact_scores.footprint_radius(footprint)
    outside = contact_scores.distance_px(footprint) > margin
    fraction = float(outside.mean())
    pair = (simulated, real)
    if fraction < MIN_LIGHT_FRACTION:
        return None
    # Noise in the fitted variable would pull the gain towards zero.
    x, y = (cv2.GaussianBlur(a.astype(np.float64), (0, 0), LIGHT_SMOOTHING_PX) for a in pair)
    gains, offsets = zip(*(_fit_line(x[outside, k], y[outside, k]) for k in range(3)), strict=True)
    return LightResidual(gain=gains, offset=offsets, pixel_fraction=fraction)


def _fit_line(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    variance = float(x.var())
    gain = float(np.mean((x - x.mean()) * (y - y.mean()))) / variance if variance > 0.0 else 1.0
    return gain, float(y.mean()) - gain * float(x.mean())


def apply_light(image: ImageArray, light: LightResidual) -> ImageArray:
    """Return gain * image + offset, rounded and clipped to 8 bits."""
    return _to_image(image * np.array(light.gain) + np.array(light.offset))


def _to_image(values: FloatArray) -> ImageArray:
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def _pose(shift: tuple[float, float], scale: tuple[float, float] | None) -> PoseResidual:
    x, y = shift
    x_mm, y_mm = (None, None) if scale is None else (x * scale[0], y * scale[1])
    return PoseResidual(x_px=x, y_px=y, x_mm=x_mm, y_mm=y_mm)
