"""Markers found in images, and their displacement from a frame at rest to a loaded one, in mm."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sim.arrays import FloatArray
from sim.optics.camera_geometry import CameraGeometry, ImageArray
from sim.optics.markers.detection import dark_markers
from tacauchy_rig.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerTracks:
    """Markers of a frame at rest that were found again.

    Attributes:
        rest_px: Centres at rest [px], shape [n, 2].
        moved_px: Centres of the same markers in the loaded frame [px], shape [n, 2].
        places_m: Centres at rest on the pad [m], shape [n, 2].
        displacement_m: Along the pad's x and y [m], shape [n, 2].
        lost: Markers at rest with no partner.
    """

    rest_px: FloatArray
    moved_px: FloatArray
    places_m: FloatArray
    displacement_m: FloatArray
    lost: int


def track_markers(
    rest: ImageArray, loaded: ImageArray, geometry: CameraGeometry, *, radius_m: float
) -> MarkerTracks:
    """Find the markers in both frames and pair each with its nearest, both ways.

    Args:
        rest: Frame without contact, RGB or grey.
        loaded: Frame with contact, likewise.
        geometry: Pixels.
        radius_m: Radius of the markers [m].

    Raises:
        ConfigError: The frame at rest shows no marker.
    """
    radius_px = radius_m / geometry.mean_scale_m
    first = dark_markers(_grey(rest), radius_px=radius_px)
    second = dark_markers(_grey(loaded), radius_px=radius_px)
    if len(first) == 0:
        raise ConfigError(
            "the frame at rest shows no marker",
            remedy="check the sensor file's [markers] radius and pixel size against the image",
        )
    if len(second) == 0:
        second = np.full((1, 2), np.inf)
    there, back = cKDTree(second).query(first)[1], cKDTree(first).query(second)[1]
    paired = back[np.minimum(there, len(second) - 1)] == np.arange(len(first))
    rest_px, moved_px = first[paired], second[there[paired]]
    places = geometry.to_pad(rest_px)
    return MarkerTracks(
        rest_px=rest_px,
        moved_px=moved_px,
        places_m=places,
        displacement_m=geometry.to_pad(moved_px) - places,
        lost=int(np.sum(~paired)),
    )


def _grey(image: ImageArray) -> NDArray[np.uint8]:
    if image.ndim == 2:
        return image
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
