"""Scores of the contact alone: the change against the no-contact frame, where the gel is touched.

Full-frame scores hardly see a contact that covers a tenth of the frame; these see nothing else.
The region always comes from the real image, so a simulated image cannot choose where it is judged.

Scores without shift and change of light between a simulated and a real contact stand second to the
raw scores, and say what was corrected.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from types import EllipsisType
from typing import NamedTuple

import cv2
import numpy as np

from reports.evidence.evidence_types import TrialImages
from reports.scores.image_metrics import (
    ImageScores,
    check_image_pair,
    finite,
    score,
    structural_similarity_index,
    zero_mean_correlation,
)
from tacauchy_rig.core.arrays import BoolArray, Float32Array, FloatArray, ImageArray

SMOOTHING_PX = 2.0
PEAK_FRACTION = 0.5
NOISE_FACTOR = 8.0
MIN_CHANGE_LEVELS = 4.0
COMPONENT_FRACTION = 0.10
MIN_AREA_FRACTION = 0.002
REGION_MARGIN = 0.25
RING = (1.1, 2.2)  # radii of a contact between which skirt and shadows are scored by themselves
CROP_RADII = 1.5  # half of the crop's side: the mark, and half of its radius around it
MIN_CROP_PX = 16  # SSIM's window of 11 px moves in it


class Touched(NamedTuple):
    """Where an image shows a contact; the region is the footprint with the gel's skirt."""

    footprint: BoolArray
    region: BoolArray


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactScores:
    """How well the simulated change of the image matches the real one."""

    zncc: float  # correlation of the two changes inside the region: place and shape
    # Norm of the difference of the changes over the norm of the real one: amplitude, so force. 0 is
    # perfect, 1 is what predicting no contact gives.
    relative_residual: float
    ring_residual: float  # the same of a ring around the footprint: skirt and shadows
    error_levels: float  # mean absolute error inside the region [grey level]
    ssim_crop: float  # SSIM of a square around the real footprint
    mask_iou: float  # overlap of the two footprints over their union
    centroid_error_px: float  # distance of the footprints' centroids [px]
    radius_error_px: float  # simulated minus real radius of a disc of the footprint's area [px]
    centroid_error_mm: float | None = None  # None when the scale [mm/px] is unknown
    radius_error_mm: float | None = None


def image_change(image: ImageArray, reference: ImageArray) -> FloatArray:
    """Subtract the no-contact frame, shape [height, width, 3] [grey level]."""
    check_image_pair(image, reference)
    return image.astype(np.float64) - reference.astype(np.float64)


def contact_footprint(change: FloatArray) -> BoolArray | None:
    """Find where the gel is deformed.

    The footprint is the convex hull of the pixels that changed by more than half of the peak: a
    flat punch changes the image at its rim and hardly inside. It includes part of the gel's skirt,
    so its radius is that of the visible mark, not of the contact. A uniform change of the light
    is taken off first. None where nothing stands out from the noise.
    """
    smooth = cv2.GaussianBlur(change, (0, 0), SMOOTHING_PX)
    magnitude = np.linalg.norm(smooth - np.median(smooth, axis=(0, 1)), axis=2)
    threshold = max(
        PEAK_FRACTION * float(np.percentile(magnitude, 99.5)),
        NOISE_FACTOR * smoothed_noise(change),
        MIN_CHANGE_LEVELS,
    )
    beyond = (magnitude > threshold).astype(np.uint8)
    count, labels, statistics, _ = cv2.connectedComponentsWithStats(beyond, connectivity=4)
    areas = statistics[1:, cv2.CC_STAT_AREA]
    if count == 1 or areas.max() < MIN_AREA_FRACTION * magnitude.size:
        return None
    kept = 1 + np.flatnonzero(areas >= COMPONENT_FRACTION * areas.max())
    points = np.argwhere(np.isin(labels, kept))[:, ::-1].astype(np.int32)
    hull = np.zeros(magnitude.shape, dtype=np.uint8)
    cv2.fillConvexPoly(hull, cv2.convexHull(points), 1)
    return hull.astype(np.bool_)


def smoothed_noise(change: FloatArray) -> float:
    """Estimate what camera noise leaves after the smoothing, over all channels [grey level].

    From differences of neighbouring pixels, where a contact hardly shows: its own skirt may
    cover half of the frame.
    """
    sigma = 1.4826 * float(np.median(np.abs(np.diff(change, axis=1)))) / math.sqrt(2.0)
    return math.sqrt(3.0) * sigma / (2.0 * math.sqrt(math.pi) * SMOOTHING_PX)


def contact_region(footprint: BoolArray) -> BoolArray:
    """Widen a footprint by a quarter of its radius, so that the gel's skirt is judged too."""
    margin = max(1, round(REGION_MARGIN * footprint_radius(footprint)))
    return distance_px(footprint) <= margin


def contact_ring(footprint: BoolArray) -> BoolArray:
    """Return what lies 0.1 to 1.2 of a footprint's radius beside it."""
    away = distance_px(footprint) / footprint_radius(footprint)
    return (away > RING[0] - 1.0) & (away <= RING[1] - 1.0)


def distance_px(footprint: BoolArray) -> Float32Array:
    """Return how far each pixel is from a footprint, shape [height, width] [px]."""
    outside = (~footprint).astype(np.uint8)
    found = cv2.distanceTransform(outside, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(found, dtype=np.float32)


def rectangle_around(region: BoolArray, *, margin_px: int) -> tuple[slice, slice]:
    """Return the rows and columns of a region and of a margin [px] around it, within the image."""
    rows, columns = (np.flatnonzero(region.any(axis=axis)) for axis in (1, 0))
    return (
        slice(max(0, rows[0] - margin_px), min(rows[-1] + 1 + margin_px, region.shape[0])),
        slice(max(0, columns[0] - margin_px), min(columns[-1] + 1 + margin_px, region.shape[1])),
    )


def contact_crop(footprint: BoolArray) -> tuple[slice, slice]:
    """Return the square around a footprint, moved to lie in the image and no larger than it."""
    half = max(MIN_CROP_PX / 2, CROP_RADII * footprint_radius(footprint))
    middle = np.argwhere(footprint).mean(axis=0)

    def along(centre: float, size: int) -> slice:
        side = min(size, round(2 * half))
        start = int(np.clip(round(centre - half), 0, size - side))
        return slice(start, start + side)

    height, width = footprint.shape
    return along(float(middle[0]), height), along(float(middle[1]), width)


def footprint_radius(footprint: BoolArray) -> float:
    """Return the radius [px] of a disc of the same area."""
    return math.sqrt(float(footprint.sum()) / math.pi)


def relative_residual(
    real: FloatArray, simulated: FloatArray, region: BoolArray | EllipsisType = ...
) -> float:
    """Return |real - simulated| / |real| of two changes inside ``region``; NaN without a change."""
    norm = float(np.linalg.norm(real[region]))
    return float(np.linalg.norm((real - simulated)[region])) / norm if norm > 0.0 else math.nan


@lru_cache(maxsize=256)
def touched(images: TrialImages) -> Touched | None:
    """Return where a trial's real image shows a contact, found once; None where it shows none."""
    footprint = contact_footprint(image_change(images.real, images.reference))
    return None if footprint is None else Touched(footprint, contact_region(footprint))


def score_contact(
    images: TrialImages, simulated: ImageArray, *, scale_mm_px: tuple[float, float] | None = None
) -> ContactScores | None:
    """Score the contact of one trial.

    Args:
        images: What the camera saw; both changes are taken against its no-contact frame.
        simulated: What the replay rendered.
        scale_mm_px: Gel surface per pixel along x and y [mm/px].

    Returns:
        The scores, or None when the real image shows no contact. A simulated image without a
        visible contact scores an overlap of 0 and NaN distances.
    """
    real_change, simulated_change = _changes(images, simulated)
    seen = touched(images)
    if seen is None:
        return None
    footprint, region = seen
    crop = contact_crop(footprint)
    other = contact_footprint(simulated_change)
    offset_px, radius_error_px, iou = (math.nan, math.nan), math.nan, 0.0
    if other is not None:
        offset_px = _centroid_offset(footprint, other)
        radius_error_px = footprint_radius(other) - footprint_radius(footprint)
        iou = float((footprint & other).sum()) / float((footprint | other).sum())
    scale = scale_mm_px or (math.nan, math.nan)
    return ContactScores(
        zncc=zero_mean_correlation(real_change[region], simulated_change[region]),
        relative_residual=relative_residual(real_change, simulated_change, region),
        ring_residual=relative_residual(real_change, simulated_change, contact_ring(footprint)),
        error_levels=float(np.mean(np.abs((simulated_change - real_change)[region]))),
        ssim_crop=structural_similarity_index(images.real[crop], simulated[crop]),
        mask_iou=iou,
        centroid_error_px=math.hypot(*offset_px),
        radius_error_px=radius_error_px,
        centroid_error_mm=finite(math.hypot(offset_px[0] * scale[0], offset_px[1] * scale[1])),
        radius_error_mm=finite(radius_error_px * math.sqrt(scale[0] * scale[1])),
    )


def _changes(images: TrialImages, simulated: ImageArray) -> tuple[FloatArray, FloatArray]:
    reference = images.reference
    return image_change(images.real, reference), image_change(simulated, reference)


def _centroid_offset(first: BoolArray, second: BoolArray) -> tuple[float, float]:
    a, b = np.argwhere(first).mean(axis=0), np.argwhere(second).mean(axis=0)
    return float(b[1] - a[1]), float(b[0] - a[0])


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Corrections:
    """Residuals of pose and light, and the scores with them taken out."""

    pose: PoseResidual | None
    light: LightResidual | None
    metrics_pose_light_corrected: ImageScores | None
    # The light is taken out of the no-contact frame as well.
    contact_pose_light_corrected: ContactScores | None


def correct(
    images: TrialImages, simulated: ImageArray, *, scale_mm_px: tuple[float, float] | None = None
) -> Corrections | None:
    """Fit pose and light residuals and score again; arguments as of ``score_contact``.

    Returns:
        None when the real image shows no contact.
    """
    real_change, simulated_change = _changes(images, simulated)
    seen, real = touched(images), images.real
    if seen is None:
        return None
    shift = register_changes(real_change, simulated_change, seen.region)
    light = fit_light(real, simulated, seen.footprint)
    moved = simulated
    if shift is not None:
        moved = _to_image(images.reference + shift_change(simulated_change, *shift))
    metrics, contact = None, None
    if light is not None:
        lit, bare = apply_light(moved, light), apply_light(images.reference, light)
        metrics = score(real, lit)
        contact = score_contact(replace(images, reference=bare), lit, scale_mm_px=scale_mm_px)
    return Corrections(
        pose=None if shift is None else _pose(shift, scale_mm_px),
        light=light,
        metrics_pose_light_corrected=metrics,
        contact_pose_light_corrected=contact,
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
    reach = footprint_radius(region)
    around = rectangle_around(region, margin_px=1)  # for the gradients at its edge
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
    margin = LIGHT_MARGIN_RADII * footprint_radius(footprint)
    outside = distance_px(footprint) > margin
    pair = (simulated, real)
    if outside.mean() < MIN_LIGHT_FRACTION:
        return None
    # Noise in the fitted variable would pull the gain towards zero.
    x, y = (cv2.GaussianBlur(a.astype(np.float64), (0, 0), LIGHT_SMOOTHING_PX) for a in pair)
    gains, offsets = zip(*(_fit_line(x[outside, k], y[outside, k]) for k in range(3)), strict=True)
    return LightResidual(gain=gains, offset=offsets)


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
