"""Dark markers of known size found in images, and their way from a frame at rest, in mm."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.rgb import to_grey

_FAINTEST = 0.25  # of what the gel around a marker reflects
_WINDOW_RADII = 1.6
_ROUNDS = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerTracks:
    """Markers of a frame at rest that were found again.

    Attributes:
        places_m: Centres at rest on the pad [m], shape [n, 2].
        displacement_m: Along the pad's x and y [m], shape [n, 2].
        lost: Markers at rest with no partner.
    """

    places_m: FloatArray
    displacement_m: FloatArray
    lost: int


def track_markers(
    rest: ImageArray, loaded: ImageArray, geometry: CameraGeometry, *, radius_m: float
) -> MarkerTracks:
    """Find the markers of a radius [m] in both frames and pair each with its nearest, both ways.

    Raises:
        ConfigError: The frame at rest shows no marker.
    """
    radius_px = radius_m / geometry.mean_scale_m
    first = dark_markers(to_grey(rest), radius_px=radius_px)
    second = dark_markers(to_grey(loaded), radius_px=radius_px)
    if len(first) == 0:
        raise ConfigError(
            "the frame at rest shows no marker",
            remedy="check the sensor file's [markers] radius and pixel size against the image",
        )
    if len(second) == 0:
        second = np.full((1, 2), np.inf)
    there, back = cKDTree(second).query(first)[1], cKDTree(first).query(second)[1]
    paired = back[np.minimum(there, len(second) - 1)] == np.arange(len(first))
    places = geometry.to_pad(first[paired])
    return MarkerTracks(
        places_m=places,
        displacement_m=geometry.to_pad(second[there[paired]]) - places,
        lost=int(np.sum(~paired)),
    )


def dark_markers(image: ImageArray, *, radius_px: float) -> FloatArray:
    """Find dots of a radius that are darker than the gel around them: column and row [px], [n, 2].

    Ink takes a share of the light, whatever the light: the share is what is weighed, against the
    median of a window that is wider than a marker.
    """
    window = 2 * round(2.5 * radius_px) + 1
    around = cv2.medianBlur(image, window).astype(np.float64)
    share = 1.0 - image / np.maximum(around, 1.0)
    smooth = ndimage.gaussian_filter(share, 0.5 * radius_px)
    peak = smooth == ndimage.maximum_filter(smooth, size=window)
    places = np.argwhere(peak & (smooth > _FAINTEST)).astype(np.float64).tolist()
    found = [_centre(share, column, row, radius_px) for row, column in places]
    return np.array([centre for centre in found if centre is not None]).reshape(-1, 2)


def _centre(
    share: FloatArray, column: float, row: float, radius_px: float
) -> tuple[float, float] | None:
    """Move a soft round window to the centre of what it holds; None at the image's border."""
    height, width = share.shape
    reach = _WINDOW_RADII * radius_px
    for _ in range(_ROUNDS):
        if not (reach <= column <= width - 1 - reach and reach <= row <= height - 1 - reach):
            return None
        left, top = int(column - reach), int(row - reach)
        size = int(2 * reach) + 3
        part = share[top : top + size, left : left + size]
        j, i = np.mgrid[: part.shape[0], : part.shape[1]]
        distance = np.hypot(i + left - column, j + top - row)
        weight = np.maximum(part, 0.0) * np.clip(reach - distance + 0.5, 0.0, 1.0)
        total = max(float(weight.sum()), 1e-9)
        column = left + float((weight * i).sum()) / total
        row = top + float((weight * j).sum()) / total
    return column, row
