"""Scores of the contact alone: the change against the no-contact frame, where the gel is touched.

Full-frame scores hardly see a contact that covers a tenth of the frame; these see nothing else.
The region always comes from the real image, so a simulated image cannot choose where it is judged.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from types import EllipsisType
from typing import NamedTuple

import cv2
import numpy as np

from reports.evidence.evidence_types import TrialImages
from reports.scores.image_metrics import (
    check_image_pair,
    finite,
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
    radius_real_px: float
    centroid_error_mm: float | None = None  # None when the scale [mm/px] is unknown
    radius_error_mm: float | None = None
    radius_real_mm: float | None = None


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
    return touched_by(image_change(images.real, images.reference))


def touched_by(change: FloatArray) -> Touched | None:
    """Return where a change shows a contact; None where it shows none."""
    footprint = contact_footprint(change)
    return None if footprint is None else Touched(footprint, contact_region(footprint))


def score_contact(
    real: ImageArray,
    simulated: ImageArray,
    reference: ImageArray,
    *,
    scale_mm_px: tuple[float, float] | None = None,
    seen: Touched | None = None,
) -> ContactScores | None:
    """Score the contact of one trial.

    Args:
        real: What the camera saw; ``simulated``, what the replay rendered.
        reference: The real no-contact frame; both changes are taken against it.
        scale_mm_px: Gel surface per pixel along x and y [mm/px].
        seen: Where the real image shows the contact, if that was found before.

    Returns:
        The scores, or None when the real image shows no contact. A simulated image without a
        visible contact scores an overlap of 0 and NaN distances.
    """
    real_change, simulated_change = (image_change(seen, reference) for seen in (real, simulated))
    seen = seen or touched_by(real_change)
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
    mean_scale = math.sqrt(scale[0] * scale[1])
    return ContactScores(
        zncc=zero_mean_correlation(real_change[region], simulated_change[region]),
        relative_residual=relative_residual(real_change, simulated_change, region),
        ring_residual=relative_residual(real_change, simulated_change, contact_ring(footprint)),
        error_levels=float(np.mean(np.abs((simulated_change - real_change)[region]))),
        ssim_crop=structural_similarity_index(real[crop], simulated[crop]),
        mask_iou=iou,
        centroid_error_px=math.hypot(*offset_px),
        radius_error_px=radius_error_px,
        radius_real_px=footprint_radius(footprint),
        centroid_error_mm=finite(math.hypot(offset_px[0] * scale[0], offset_px[1] * scale[1])),
        radius_error_mm=finite(radius_error_px * mean_scale),
        radius_real_mm=finite(footprint_radius(footprint) * mean_scale),
    )


def _centroid_offset(first: BoolArray, second: BoolArray) -> tuple[float, float]:
    a, b = np.argwhere(first).mean(axis=0), np.argwhere(second).mean(axis=0)
    return float(b[1] - a[1]), float(b[0] - a[0])
