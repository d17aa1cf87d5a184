"""How much of the difference is a shifted pose and a changed light, and the scores without them.

Nothing here replaces a raw score: corrected scores stand second, and say what was corrected.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage

from reports.scores.contact import (
    ContactScores,
    contact_footprint,
    contact_region,
    footprint_radius,
    image_change,
    rectangle_around,
    score_contact,
)
from reports.scores.metrics import ImageScores, score
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
    """Translation that brings the simulated contact onto the real one.

    Attributes:
        x_px: Positive: the real contact lies to the right of the simulated one [px].
        y_px: Positive: the real contact lies below the simulated one [px].
        x_mm: The same in mm; None when the scale is unknown.
    """

    x_px: float
    y_px: float
    x_mm: float | None = None
    y_mm: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LightResidual:
    """real = gain * simulated + offset, fitted per channel (R, G, B) outside the contact.

    Attributes:
        offset: [grey level].
        pixel_fraction: Part of the frame that the fit used.
    """

    gain: tuple[float, float, float]
    offset: tuple[float, float, float]
    pixel_fraction: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Corrections:
    """Residuals of pose and light, and the scores with them taken out.

    Attributes:
        contact_pose_light_corrected: The light is taken out of the no-contact frame as well.
    """

    pose: PoseResidual | None
    light: LightResidual | None
    metrics_pose_corrected: ImageScores | None
    metrics_pose_light_corrected: ImageScores | None
    contact_pose_light_corrected: ContactScores | None


def correct(
    real: ImageArray,
    simulated: ImageArray,
    reference: ImageArray,
    *,
    scale_mm_px: tuple[float, float] | None = None,
) -> Corrections | None:
    """Fit pose and light residuals and score again.

    Args:
        real: What the camera saw.
        simulated: What the replay rendered.
        reference: The real no-contact frame.
        scale_mm_px: Gel surface per pixel along x and y [mm/px].

    Returns:
        None when the real image shows no contact.
    """
    real_change, simulated_change = (image_change(seen, reference) for seen in (real, simulated))
    footprint = contact_footprint(real_change)
    if footprint is None:
        return None
    shift = register_changes(real_change, simulated_change, contact_region(footprint))
    light = fit_light(real, simulated, footprint)
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
        else score_contact(real, lit, apply_light(reference, light), scale_mm_px=scale_mm_px),
    )


def register_changes(
    real: FloatArray, simulated: FloatArray, region: BoolArray
) -> tuple[float, float] | None:
    """Find the translation (x, y) [px] of ``simulated`` that fits ``real`` best inside ``region``.

    Gauss-Newton on all channels from coarse to fine smoothing, with one free amplitude so that a
    weaker simulated contact is not mistaken for a shifted one.

    Returns:
        The translation, or None when the fit leaves the region's own size.
    """
    x, y = 0.0, 0.0
    reach = footprint_radius(region)
    around = rectangle_around(region, margin_px=1)  # for the gradients at its edge
    for smoothing in PYRAMID_PX:
        target = _smooth(real, smoothing)[region].ravel()
        source = _smooth(simulated, smoothing)
        for _ in range(MAX_STEPS):
            moved = shift_change(source, x, y)[around]
            step = _register_step(target, moved, region[around])
            x, y = x + step[0], y + step[1]
            if math.hypot(x, y) > reach:
                return None
            if math.hypot(*step) < STEP_TOLERANCE_PX:
                break
    return x, y


def _smooth(change: FloatArray, sigma_px: float) -> FloatArray:
    level = change - np.median(change, axis=(0, 1))
    return np.asarray(cv2.GaussianBlur(level, (0, 0), sigma_px), dtype=np.float64)


def _register_step(target: FloatArray, moved: FloatArray, region: BoolArray) -> tuple[float, float]:
    columns = [moved, -np.gradient(moved, axis=1), -np.gradient(moved, axis=0)]
    matrix = np.stack([column[region].ravel() for column in columns], axis=1)
    amplitude, along_x, along_y = np.linalg.lstsq(matrix, target, rcond=None)[0]
    if abs(amplitude) < FAINTEST_AMPLITUDE:
        return math.inf, math.inf
    x, y = np.clip(np.array([along_x, along_y]) / amplitude, -MAX_STEP_PX, MAX_STEP_PX).tolist()
    return x, y


def shift_change(change: FloatArray, x_px: float, y_px: float) -> FloatArray:
    """Move a change by (x, y) [px]; what comes in from outside is unchanged gel, so zero."""
    height, width = change.shape[:2]
    matrix = np.array([[1.0, 0.0, x_px], [0.0, 1.0, y_px]])
    return np.asarray(
        cv2.warpAffine(change, matrix, (width, height), flags=cv2.INTER_CUBIC), dtype=np.float64
    )


def fit_light(
    real: ImageArray, simulated: ImageArray, footprint: BoolArray
) -> LightResidual | None:
    """Fit gain and offset per channel by least squares well outside the contact.

    Returns:
        None when less than 5 % of the frame lies outside.
    """
    margin = LIGHT_MARGIN_RADII * footprint_radius(footprint)
    outside = ndimage.distance_transform_edt(~footprint) > margin
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
    if scale is None:
        return PoseResidual(x_px=shift[0], y_px=shift[1])
    return PoseResidual(
        x_px=shift[0], y_px=shift[1], x_mm=shift[0] * scale[0], y_mm=shift[1] * scale[1]
    )
